//! Search for kinks of a step: compares the active sets of an environment and its perturbed copies.
//!
//! A step with contact is differentiable if all copies have the same active set. The active set lists contacts that push, stick and slip,
//! joints at their limits or held by dry friction, and saturated actuators. It also lists geoms that tendons touch, and contacts that
//! adhesion pulls. If two copies have different active sets, a kink is between them. Switch values give the distance to the kink to first
//! order, as a multiple of the perturbation. A switch value is a quantity that is zero at a kink, such as a normal force, the margin to
//! slipping, or a gap.

use std::cmp::Ordering;

use stepper_core::group_step::check_length;
use stepper_core::model::Pair;
use stepper_core::{Contact, ContactLaw, Error, MAX_FRICTION, Model, Outcome, Parameter, Simulation, Status};

use crate::kink::*;

/// Flags of kinks for which [`ActiveSet`] lists the active constraints, in the order of these lists.
const LISTED: [u32; 8] = [CONTACT, SLIP, GAP, LIMIT, DRY_FRICTION, SATURATION, WRAP, ADHESION];

/// Ratio of a contact's normal force to the largest normal force in the environment, above which the contact counts as pushing.
const PUSHES: f64 = 1e-9;
/// Margin to slipping below which a contact counts as slipping, N per N of normal force, see [`ContactFriction::slack`]. Evidence:
/// solutions reach the bound of friction to 1e-12.
const SLIPS: f64 = 1e-6;
/// Distance of a joint position from the end of its range, below which the joint counts as being at its limit, rad or m. Evidence: the
/// position solve of a step ends within 1e-7.
const AT_LIMIT: f64 = 1e-6;
/// Joint speed below which dry friction counts as holding the joint, m/s or rad/s.
const HELD: f64 = 1e-9;

/// Layout of the perturbed copies of environments in a batch, and the inputs of their comparison.
///
/// The batch contains `count` copies of each original environment e, with the indices e * count + k for the copies k. Copy 0 is
/// unperturbed. Copy 1 + side * columns + column is perturbed in the coordinate with the index `column`. The first copies, with a side
/// below `sides`, determine the distance to a kink. Further copies are only compared with copy 0.
#[derive(Clone, Copy, Debug)]
pub struct PerturbedCopies<'a> {
    /// Number of copies of each environment, including the unperturbed one.
    pub count: usize,
    /// Number of coordinates that are perturbed (columns of the derivative).
    pub columns: usize,
    /// Number of copies per coordinate that determine the distance to a kink: 1 or 2. Two copies are displaced in opposite directions,
    /// unless `one_sided` is true.
    pub sides: usize,
    /// Whether both copies of a coordinate are displaced in the same direction, (environments, columns), for each original environment. The
    /// displacements are then one and two times the perturbation.
    pub one_sided: &'a [bool],
    /// Joints whose limits are checked for kinks: address of each in qpos, and in qvel.
    pub limited: &'a [[usize; 2]],
    /// Lowest and highest position of each of the n joints in `limited`, m or rad: (num_envs, n, 2), or (n, 2) for all environments of the
    /// batch.
    pub ranges: &'a [f64],
    /// Joint positions at which the last step evaluated the limits of the n joints in `limited`, m or rad: (num_envs, n).
    pub limit_positions: &'a [f64],
    /// Indices of the degrees of freedom whose dry friction is checked for kinks.
    pub rubbing: &'a [usize],
    /// Whether one smooth function of the distance gives the target velocity of open and of overlapping contacts. Then the distance 0 is no
    /// kink.
    pub smooth_at_rest: bool,
    /// Residual above which a step counts as unsolved, m/s.
    pub tolerance: f64,
}

/// Result of the search for kinks between copies of environments.
#[derive(Clone, Debug)]
pub struct Kinks {
    /// Flags of the kinks between the copies of each original environment, for each perturbed coordinate (column): (environments, columns),
    /// see [`kink`](crate::kink).
    pub causes: Vec<u32>,
    /// Distance to the nearest kink in each environment, as a multiple of the perturbation; infinite if no distance is known.
    pub distance: Vec<f64>,
}

/// Active set of one environment: its active constraints, and its switch values, which are quantities that are zero at a kink.
#[derive(Clone, Debug, Default)]
struct ActiveSet {
    /// Numbers that identify the active constraints, one list for each flag in [`LISTED`]. They are indices of geoms, of pushing contacts,
    /// of ends of joint ranges, of degrees of freedom, and of actuators. The last two lists are those of [`Simulation::switches`].
    lists: [Vec<usize>; 8],
    /// Switch values of each contact that pushes: normal force, margin to slipping, and gap. A NaN gives no distance to a kink.
    contacts: Vec<[f64; 3]>,
    /// Switch values of joint limits and of dry friction: distances from the limits, m or rad, and joint velocities, m/s or rad/s. A NaN
    /// gives no distance to a kink.
    joints: Vec<f64>,
    /// Whether the step of the environment is unreliable: not solved, not finite, or with one of the flags CONTACTS_FULL, UNRESOLVED and
    /// INFEASIBLE of [`Status`].
    unsolved: bool,
}

/// Finds the kinks between the perturbed copies of each environment, after a step of the batch `sim`.
///
/// # Errors
/// [`Error::Length`] for an array of the wrong length; [`Error::Element`] for a degree of freedom that does not exist.
pub fn find_kinks(sim: &Simulation, copies: &PerturbedCopies<'_>) -> Result<Kinks, Error> {
    check_copies(sim, copies)?;
    let PerturbedCopies { count, columns, sides, .. } = *copies;
    let environments = sim.num_envs() / count;
    let mut kinks = Kinks { causes: vec![0; environments * columns], distance: vec![f64::INFINITY; environments] };
    let (mut nominal, mut copy) = (ActiveSet::default(), ActiveSet::default());
    // Changes of the switch values from the unperturbed copy to the copies on the first side of each column.
    let mut first = vec![Vec::new(); columns];
    for e in 0..environments {
        read_active_set(sim, copies, e * count, &mut nominal);
        let (causes, distance) = (&mut kinks.causes[e * columns..(e + 1) * columns], &mut kinks.distance[e]);
        if nominal.unsolved {
            causes.iter_mut().for_each(|cause| *cause |= UNSOLVED);
        }
        for k in 1..count {
            let column = (k - 1) % columns;
            read_active_set(sim, copies, e * count + k, &mut copy);
            let differs = nominal.difference(&copy);
            causes[column] |= differs | if copy.unsolved { UNSOLVED } else { 0 };
            if differs != 0 {
                // A kink between the copies is within one perturbation, independent of the first-order estimate.
                *distance = distance.min(1.0);
            }
            let side = (k - 1) / columns;
            if side + 1 < sides {
                nominal.changes(&copy, &mut first[column]);
            } else if side + 1 == sides {
                let weights = match (sides, copies.one_sided[e * columns + column]) {
                    (1, _) => [0.0, 1.0],
                    (_, true) => [2.0, -0.5],
                    (_, false) => [0.5, -0.5],
                };
                *distance = distance.min(nominal.widths(&first[column], &copy, weights));
            }
        }
    }
    Ok(kinks)
}

fn check_copies(sim: &Simulation, copies: &PerturbedCopies<'_>) -> Result<(), Error> {
    let PerturbedCopies { count, columns, sides, one_sided, limited, ranges, limit_positions, rubbing, .. } = *copies;
    let environments = sim.num_envs() / count.max(1);
    check_length("copies", environments.saturating_mul(count), sim.num_envs())?;
    let perturbed = sides.saturating_mul(columns);
    if count > 1 && (perturbed == 0 || !(count - 1).is_multiple_of(perturbed)) {
        let detail = format!(" for copies of {columns} columns on {sides} sides, a multiple of both");
        return Err(Error::Length { name: "copies beside the nominal one", found: count - 1, must: perturbed, detail });
    }
    check_length("one_sided", one_sided.len(), environments * columns)?;
    let shared = |found: usize, row: usize| if found == row { row } else { sim.num_envs() * row };
    let row = 2 * limited.len();
    check_length("ranges", ranges.len(), shared(ranges.len(), row))?;
    check_length("limit_positions", limit_positions.len(), sim.num_envs() * limited.len())?;
    let (nq, nv) = (sim.model().nq(), sim.model().nv());
    let places = limited.iter().map(|&[q, _]| (q, nq)).chain(limited.iter().map(|&[_, v]| (v, nv)));
    let beyond = places.chain(rubbing.iter().map(|&v| (v, nv))).find(|(found, count)| found >= count);
    beyond.map_or(Ok(()), |(found, count)| Err(Error::Element { element: "degree of freedom", found, count }))
}

fn read_active_set(sim: &Simulation, copies: &PerturbedCopies<'_>, env: usize, out: &mut ActiveSet) {
    out.clear();
    let hard = sim.options().contact == ContactLaw::Hard;
    let Outcome { status, residual, .. } = sim.outcome(env);
    let harmful = Status::NON_FINITE | Status::CONTACTS_FULL | Status::UNRESOLVED | Status::INFEASIBLE;
    let loose = residual > copies.tolerance;
    // NOT_CONVERGED is acceptable up to `copies.tolerance`, which may be larger than the tolerance of the options.
    out.unsolved = status.intersects(harmful) || (loose && status.intersects(Status::NOT_CONVERGED));
    read_contacts(sim, copies, env, hard, out);
    read_joints(sim, copies, env, hard, out);
    let [.., saturated, wraps, adhesion] = &mut out.lists;
    for (list, switches) in [wraps, adhesion].into_iter().zip(sim.switches(env)) {
        list.extend(switches.into_iter().map(|switch| switch as usize));
    }
    saturated.extend(sim.actuator_saturation(env).iter().enumerate().filter(|(_, n)| **n > 0).map(|(i, _)| i));
}

fn read_contacts(sim: &Simulation, copies: &PerturbedCopies<'_>, env: usize, hard: bool, out: &mut ActiveSet) {
    let ActiveSet { lists: [pushes, slipping, gaps, ..], contacts: numbers, .. } = out;
    let contacts = sim.contacts(env);
    let largest = contacts.iter().map(|c| c.force[0]).fold(0.0, f64::max);
    let friction = hard.then(|| contact_friction(sim, env));
    for (i, c) in contacts.iter().filter(|c| c.force[0] > PUSHES * largest).enumerate() {
        pushes.extend(c.geoms);
        let Some(friction) = &friction else {
            numbers.push([c.force[0], f64::NAN, f64::NAN]);
            continue;
        };
        let slack = friction.slack(c);
        let slips = slack < SLIPS * c.force[0];
        slipping.extend(slips.then_some(i));
        gaps.extend((!copies.smooth_at_rest && c.distance < 0.0).then_some(i));
        let gap = if copies.smooth_at_rest { f64::NAN } else { c.distance };
        numbers.push([c.force[0], if slips { f64::NAN } else { slack }, gap]);
    }
}

fn read_joints(sim: &Simulation, copies: &PerturbedCopies<'_>, env: usize, hard: bool, out: &mut ActiveSet) {
    let ActiveSet { lists: [_, _, gaps, limits, rubbing, ..], joints: numbers, .. } = out;
    let joints = copies.limited.len();
    if joints > 0 {
        let (q, ranges) = (sim.qpos(env), row_of(copies.ranges, env, 2 * joints));
        for (i, (&[place, _], limit_position)) in copies.limited.iter().zip(&copies.limit_positions[env * joints..]).enumerate() {
            for (side, sign) in [(0, 1.0), (1, -1.0)] {
                let end = ranges[2 * i + side];
                let (after, gap) = (sign * (q[place] - end), sign * (limit_position - end));
                let held = if hard { after < AT_LIMIT } else { gap < 0.0 };
                limits.extend(held.then_some(2 * i + side));
                numbers.push(match (hard, copies.smooth_at_rest, held) {
                    (false, ..) | (true, false, true) => gap,
                    (true, true, true) => f64::NAN,
                    (true, _, false) => after,
                });
                gaps.extend((hard && !copies.smooth_at_rest && held && gap < 0.0).then_some(usize::MAX - 2 * i - side));
            }
        }
    }
    if hard && !copies.rubbing.is_empty() {
        let v = sim.qvel(env);
        for &dof in copies.rubbing {
            let held = v[dof].abs() < HELD;
            rubbing.extend(held.then_some(dof));
            numbers.push(if held { f64::NAN } else { v[dof] });
        }
    }
}

/// Friction parameters of the contacts in one environment.
struct ContactFriction<'a> {
    model: &'a Model,
    /// Friction coefficients of the geoms in this environment, (ngeom, 3). `None` selects the coefficients of the model.
    geoms: Option<&'a [f64]>,
    /// Friction coefficients of the explicit pairs in this environment, (npair, 3). `None` selects the coefficients of the model.
    pairs: Option<&'a [f64]>,
}

fn contact_friction(sim: &Simulation, env: usize) -> ContactFriction<'_> {
    let own = |wanted: Parameter, width: usize| {
        let values = sim.per_env_fields().find(|(parameter, _)| *parameter == wanted)?.1;
        Some(&values[env * width..(env + 1) * width])
    };
    let model = sim.model();
    ContactFriction {
        model,
        geoms: own(Parameter::GeomFriction, 3 * model.geoms.len()),
        pairs: own(Parameter::PairFriction, 3 * model.pairs.len()),
    }
}

impl ContactFriction<'_> {
    /// Contact dimension (condim) of two geoms, and their sliding, torsional and rolling friction coefficients.
    fn of(&self, geoms: [usize; 2]) -> (u8, [f64; 3]) {
        let explicit = |pair: &Pair| pair.geoms == geoms || pair.geoms == [geoms[1], geoms[0]];
        let row = |own: &[f64], i: usize| [own[3 * i], own[3 * i + 1], own[3 * i + 2]];
        if let Some(k) = self.model.pairs.iter().position(explicit) {
            let pair = &self.model.pairs[k];
            return (pair.condim, self.pairs.map_or(pair.friction, |own| row(own, k)));
        }
        let [a, b] = geoms.map(|g| &self.model.geoms[g]);
        let [mu, nu] = geoms.map(|g| self.geoms.map_or(self.model.geoms[g].friction, |own| row(own, g)));
        match a.priority.cmp(&b.priority) {
            Ordering::Greater => (a.condim, mu),
            Ordering::Less => (b.condim, nu),
            Ordering::Equal => (a.condim.max(b.condim), std::array::from_fn(|k| mu[k].max(nu[k]))),
        }
    }

    /// Margin of a contact to slipping, N: normal force minus the smallest normal force at which the contact would not slip.
    ///
    /// The margin is zero (within rounding) while the contact slips, and infinite for a contact without friction.
    fn slack(&self, Contact { geoms, force, torque, .. }: &Contact) -> f64 {
        let (condim, mu) = self.of(*geoms);
        let mu = mu.map(|mu| mu.min(MAX_FRICTION));
        if condim == 1 {
            return f64::INFINITY;
        }
        let loads = [force[1] / mu[0], force[2] / mu[0], torque[0] / mu[1], torque[1] / mu[2], torque[2] / mu[2]];
        force[0] - loads.iter().filter(|x| x.is_finite()).map(|x| x * x).sum::<f64>().sqrt()
    }
}

/// Row of environment `env` in an array with one row per environment, or with one row for all.
fn row_of(all: &[f64], env: usize, width: usize) -> &[f64] {
    if all.len() == width { all } else { &all[env * width..(env + 1) * width] }
}

impl ActiveSet {
    fn clear(&mut self) {
        self.lists.iter_mut().for_each(Vec::clear);
        self.contacts.clear();
        self.joints.clear();
        self.unsolved = false;
    }

    /// Flags of [`LISTED`] whose lists of active constraints differ between this active set and `other`.
    fn difference(&self, other: &Self) -> u32 {
        let pairs = self.lists.iter().zip(&other.lists).zip(LISTED);
        pairs.fold(0, |flags, ((own, other), flag)| if own == other { flags } else { flags | flag })
    }

    /// Switch values of the active set `of`: first those of as many contacts as `self` has, then those of the joints. Contacts that `of`
    /// does not have get NaN. So the values of `self` and `of` can be compared one by one.
    fn numbers<'a>(&self, of: &'a Self) -> impl Iterator<Item = f64> + 'a {
        let contacts = (0..self.contacts.len()).flat_map(|i| of.contacts.get(i).copied().unwrap_or([f64::NAN; 3]));
        contacts.chain(of.joints.iter().copied())
    }

    /// Writes to `out` the changes of the switch values from this active set to the active set `other`.
    fn changes(&self, other: &Self, out: &mut Vec<f64>) {
        out.clear();
        out.extend(self.numbers(self).zip(self.numbers(other)).map(|(now, there)| there - now));
    }

    /// Distance to the nearest kink in one column of the derivative, to first order, as a multiple of the perturbation.
    ///
    /// `self` is the active set of the unperturbed copy. `first` has the changes of the switch values at the first perturbed copy, and
    /// `last` is the active set of the last perturbed copy. The slope of a switch value is the sum of the value's changes at the first and
    /// at the last copy, multiplied by `weights`.
    fn widths(&self, first: &[f64], last: &Self, weights: [f64; 2]) -> f64 {
        let first = first.iter().copied().chain(std::iter::repeat(0.0));
        let widths = self.numbers(self).zip(self.numbers(last)).zip(first).map(|((now, there), first)| {
            let slope = (there - now) * weights[1] + if weights[0] == 0.0 { 0.0 } else { first * weights[0] };
            (now / slope).abs()
        });
        // `min` ignores a NaN, which gives no distance.
        widths.fold(f64::INFINITY, f64::min)
    }
}

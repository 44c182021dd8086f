//! Derived quantities: computed from the states of many environments and from their last step, for a group of lanes.

use stepper_real::{Real, kernel};

use crate::analysis::smooth_dynamics::SmoothDynamics;
use crate::compile::{EqualityRows, LaneModel, coupling_error};
use crate::dynamics::kinematics::Kinematics;
use crate::dynamics::path_lengths::ARC_POINTS;
use crate::integrators::observation::read_actuator_forces;
use crate::integrators::step_input::StepInput;
use crate::integrators::workspace::Workspace;
use crate::math::spatial::*;
use crate::model::{MIN_VALUE, Model};
use crate::options::StepSettings;
use crate::sensing::{contact_wrenches, motion_of, orientations};

stepper_model::named! {
    /// Quantity that [`Simulation::derive`](crate::Simulation::derive) computes for every environment. The names in Python are MuJoCo's.
    ///
    /// Most quantities belong to the current state, as after `mj_forward`. Those of [`DerivedQuantity::is_of_last_step`] are results of the
    /// last step. If the state was set since then, they come from a trial step, which does not change the state.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
    #[non_exhaustive]
    pub enum DerivedQuantity {
        /// Positions of the bodies' frames in the world frame, m: (nbody, 3).
        BodyPos = "xpos",
        /// Orientations of the bodies' frames, quaternions (w, x, y, z): (nbody, 4).
        BodyQuat = "xquat",
        /// Linear velocities of the bodies' frame origins in world axes, m/s: (nbody, 3). Mocap bodies have zero velocity.
        BodyLinVel = "body_linvel",
        /// Angular velocities of the bodies in world axes, rad/s: (nbody, 3).
        BodyAngVel = "body_angvel",
        /// Positions of the sites in the world frame, m: (nsite, 3).
        SitePos = "site_xpos",
        /// Orientations of the sites, quaternions (w, x, y, z): (nsite, 4).
        SiteQuat = "site_xquat",
        /// Positions of the geoms in the world frame, m: (ngeom, 3).
        GeomPos = "geom_xpos",
        /// Orientations of the geoms, quaternions (w, x, y, z): (ngeom, 4).
        GeomQuat = "geom_xquat",
        /// Centre of mass of every body with its descendants in the world frame, m: (nbody, 3). If they have no mass, it is the centre of
        /// mass of the body alone.
        SubtreeCom = "subtree_com",
        /// Acceleration (v+ - v) / h of the last step: (nv), m/s^2 or rad/s^2.
        Acceleration = "qacc",
        /// Forces of the actuators before their gears, at the current state: (nu). The controls are those in force, which a step without
        /// new controls uses.
        ActuatorForce = "actuator_force",
        /// Generalized forces of the actuators, clamped to the force ranges of joints: (nv), N or N m.
        JointActuatorForce = "qfrc_actuator",
        /// Generalized force of all constraints in the last step, including contacts and limits: (nv), N or N m.
        JointConstraintForce = "qfrc_constraint",
        /// Force (N) and torque (N m) of all contacts of the last step on every body, world axes: (nbody, 6).
        ///
        /// The torque is about the body's centre of mass at the current state.
        BodyContactForce = "body_contact_force",
        /// Centres of mass of the bodies in the world frame, m: (nbody, 3).
        BodyCom = "xipos",
        /// Inertias of the bodies about the centre of mass of their kinematic tree, in world axes: (nbody, 10); zeros for the world.
        ///
        /// The first six numbers are xx, yy, zz, xy, xz, yz in kg m^2. The next three are the mass times the position of the body's centre
        /// of mass, relative to that of the tree, in kg m. The last is the mass in kg.
        BodyInertia = "cinert",
        /// Angular (rad/s) and linear (m/s) velocities of the bodies at the centre of mass of their kinematic tree, in world axes: (nbody,
        /// 6).
        BodyMotion = "cvel",
        /// Torques (N m) and forces (N) of the last step's contacts on the bodies, in world axes: (nbody, 6). The torques are about the
        /// centre of mass of the body's tree. Resets and [`Simulation::set`](crate::Simulation::set) set them to zero.
        BodyForce = "cfrc_ext",
        /// Numbers of the equalities in the layout of `eq_data` with which each has no position error at the current state: (neq, 11).
        ///
        /// A connect keeps its anchor in the first body and a weld its anchor in the second; a coupling changes its constant term.
        ClosedEqualityData = "closed_eq_data",
        /// Paths of the spatial tendons in the world frame, m: (number of segments, 10, 3). A segment is the part between two sites.
        ///
        /// Its points are the first site, eight points on the sphere or cylinder between the sites, or on the straight line, and the second
        /// site.
        TendonPaths = "tendon_paths",
        /// Mass matrix with armature, without terms that depend on the time step: (nv, nv), kg, kg m and kg m^2.
        MassMatrix = "mass_matrix",
        /// Coriolis, centrifugal and gravitational forces: (nv), N or N m.
        BiasForce = "qfrc_bias",
        /// Acceleration without constraints at the current state, with the applied inputs and the controls in force: (nv), m/s^2 or
        /// rad/s^2.
        SmoothAcceleration = "qacc_smooth",
        /// Jacobian of the origin of a body's frame in world axes: (6, nv), linear rows above angular rows. The field is the body's index.
        BodyJacobian(usize) = "jacobian",
        /// Jacobian of a site in world axes: (6, nv), linear rows above angular rows. The field is the site's index.
        SiteJacobian(usize) = "jacobian",
    }
}

impl DerivedQuantity {
    /// Shape of the quantity in one environment.
    pub fn shape(self, model: &Model) -> Vec<usize> {
        let (bodies, sites, geoms) = (model.bodies.len(), model.sites.len(), model.geoms.len());
        match self {
            Self::BodyPos | Self::BodyLinVel | Self::BodyAngVel | Self::SubtreeCom | Self::BodyCom => vec![bodies, 3],
            Self::BodyQuat => vec![bodies, 4],
            Self::SitePos => vec![sites, 3],
            Self::SiteQuat => vec![sites, 4],
            Self::GeomPos => vec![geoms, 3],
            Self::GeomQuat => vec![geoms, 4],
            Self::Acceleration | Self::JointActuatorForce | Self::JointConstraintForce => vec![model.nv()],
            Self::BiasForce | Self::SmoothAcceleration => vec![model.nv()],
            Self::MassMatrix => vec![model.nv(); 2],
            Self::ActuatorForce => vec![model.nu()],
            Self::BodyContactForce | Self::BodyMotion | Self::BodyForce => vec![bodies, 6],
            Self::BodyInertia => vec![bodies, 10],
            Self::TendonPaths => vec![model.tendons.iter().map(|tendon| tendon.segments().len()).sum(), ARC_POINTS + 2, 3],
            Self::ClosedEqualityData => vec![model.equalities.len(), 11],
            Self::BodyJacobian(_) | Self::SiteJacobian(_) => vec![6, model.nv()],
        }
    }

    /// Whether the quantity is an acceleration or force of the last step. If the state was set since that step, the quantity comes from a
    /// trial step.
    pub fn is_of_last_step(self) -> bool {
        matches!(self, Self::Acceleration | Self::JointConstraintForce | Self::BodyContactForce)
    }
}

/// Workspace for computing derived quantities of a group of environments.
#[derive(Clone, Debug, Default)]
pub(crate) struct Derivation<R: Real> {
    /// Orientation of every frame, a quaternion (w, x, y, z).
    orientation: Vec<[R; 4]>,
    /// Spatial velocity of every link at the reference point of its kinematic tree.
    velocity: Vec<V6<R>>,
    /// Mass of every body with its descendants, kg.
    mass: Vec<R>,
    /// Centre of mass of every body, m.
    centres: Vec<V3<R>>,
    /// Centre of mass of every body together with its descendants, m.
    subtrees: Vec<V3<R>>,
    /// Centre of mass of the kinematic tree to which each body belongs, m.
    references: Vec<V3<R>>,
    /// Workspace of mass matrix, bias force and smooth acceleration.
    dynamics: SmoothDynamics<R>,
    /// Flags of the intermediate results that are already computed for the current group of environments.
    cached: Cached,
    /// Values of the quantity that is being computed: one SIMD vector per value, with one environment per lane.
    values: Vec<R>,
    /// Copy of `values` as scalars, lane-interleaved: value i of lane l is at `i * lanes + l`.
    interleaved: Vec<R::Scalar>,
}

/// Flags of intermediate results that several quantities of a group share: whether each is computed.
#[derive(Clone, Copy, Debug, Default)]
struct Cached {
    poses: bool,
    orientations: bool,
    velocities: bool,
    centres: bool,
    references: bool,
}

impl<R: Real> Derivation<R> {
    /// Prepares the computation of derived quantities for a group of environments. `s` has the group's state, inputs and last step. Mocap
    /// frames get their poses at the end of the last call of `step`.
    pub(crate) fn begin(&mut self, compiled: &LaneModel<R>, s: &mut Workspace<R>) {
        self.cached = Cached::default();
        let one = [R::one(), R::zero(), R::zero(), R::zero()];
        self.orientation.resize(compiled.nframe(), one);
        let kinematics = &mut s.evaluation.kinematics;
        for (mocap, trajectory) in compiled.mocap.iter().zip(&s.inputs.mocap_trajectories) {
            let [x, y, z, quat @ ..] = trajectory.end();
            kinematics.pos[mocap.frame] = [x, y, z];
            kinematics.mat[mocap.frame] = kernel!(R, || quat_to_mat(quat));
            self.orientation[mocap.frame] = quat;
        }
    }

    /// Computes a quantity for the group that [`Derivation::begin`] received, and writes one row per environment to `out`.
    pub(crate) fn derive(
        &mut self,
        compiled: &LaneModel<R>,
        options: &StepSettings,
        s: &mut Workspace<R>,
        quantity: DerivedQuantity,
        out: &mut [R::Scalar],
    ) {
        kernel!(R, || self.evaluate(compiled, options, s, quantity));
        let n = self.values.len();
        self.interleaved.resize(n * R::LANES, R::Scalar::default());
        R::store_all(&self.values, &mut self.interleaved);
        for (lane, row) in out.chunks_exact_mut(n).enumerate() {
            for (out, &x) in row.iter_mut().zip(self.interleaved[lane..].iter().step_by(R::LANES)) {
                *out = x;
            }
        }
    }

    /// Computes a quantity into `values`, for all lanes.
    #[inline(always)]
    fn evaluate(&mut self, compiled: &LaneModel<R>, options: &StepSettings, s: &mut Workspace<R>, quantity: DerivedQuantity) {
        use DerivedQuantity as Q;
        let h = R::of(options.timestep);
        self.values.clear();
        match quantity {
            Q::Acceleration => return self.values.extend(&s.sensors.acceleration),
            Q::JointConstraintForce => {
                for &impulse in &s.state.impulse {
                    self.values.push(impulse / h);
                }
                return;
            }
            Q::ActuatorForce | Q::JointActuatorForce => {
                let Workspace { state, inputs, evaluation, velocity, sensors, alive, .. } = s;
                let (input, forces) = (StepInput { compiled, options, state, inputs, alive: *alive }, &mut sensors.actuator_forces);
                read_actuator_forces(input, &velocity.scalar_impulse, &mut evaluation.kinematics, forces);
                return self.values.extend(if quantity == Q::ActuatorForce { &forces.force } else { &forces.without_springs });
            }
            _ => {}
        }
        if !self.cached.poses {
            s.evaluation.kinematics.update(compiled, &s.state.q);
            self.cached.poses = true;
        }
        let kinematics = &s.evaluation.kinematics;
        let objects = if matches!(quantity, Q::SitePos | Q::SiteQuat) { &compiled.sensing.sites } else { &compiled.sensing.geoms };
        match quantity {
            Q::BodyPos => {
                for body in &compiled.bodies {
                    self.values.extend(kinematics.point(body.frame, splat(body.pos)));
                }
            }
            Q::SitePos | Q::GeomPos => {
                for object in objects {
                    self.values.extend(kinematics.point(object.frame, compiled.params.place(object.index)));
                }
            }
            Q::BodyQuat => {
                self.find_orientations(compiled, &s.state.q);
                for body in 0..compiled.bodies.len() {
                    self.values.extend(self.orientation_of(compiled, body));
                }
            }
            Q::SiteQuat | Q::GeomQuat => {
                self.find_orientations(compiled, &s.state.q);
                for object in objects {
                    self.values.extend(quat_mul(self.orientation[object.frame], splat(object.quat)));
                }
            }
            Q::BodyLinVel | Q::BodyAngVel => {
                self.find_velocities(compiled, kinematics, &s.state.v);
                for body in &compiled.bodies {
                    let (motion, origin) = motion_of(compiled, kinematics, &self.velocity, zero(), body.frame);
                    self.values.extend(match quantity {
                        Q::BodyLinVel => velocity_at(&motion, sub(kinematics.point(body.frame, splat(body.pos)), origin)),
                        _ => angular(&motion),
                    });
                }
            }
            Q::SubtreeCom => {
                self.find_references(compiled, kinematics);
                self.values.extend(self.subtrees.as_flattened());
            }
            Q::BodyCom => {
                self.find_centres(compiled, kinematics);
                self.values.extend(self.centres.as_flattened());
            }
            Q::BodyContactForce => {
                self.find_centres(compiled, kinematics);
                self.values.resize(6 * compiled.bodies.len(), R::zero());
                contact_wrenches(compiled, &s.state.contacts, h, &self.centres, self.values.as_chunks_mut().0);
            }
            Q::BodyInertia => self.inertias(compiled, kinematics),
            // The velocities of the bodies at the centres of mass of their kinematic trees.
            Q::BodyMotion => {
                self.find_references(compiled, kinematics);
                self.find_velocities(compiled, kinematics, &s.state.v);
                for (body, &reference) in compiled.bodies.iter().zip(&self.references) {
                    let (motion, origin) = motion_of(compiled, kinematics, &self.velocity, zero(), body.frame);
                    self.values.extend(spatial(angular(&motion), velocity_at(&motion, sub(reference, origin))));
                }
            }
            Q::BodyForce => {
                self.find_references(compiled, kinematics);
                self.values.resize(6 * compiled.bodies.len(), R::zero());
                let wrenches = self.values.as_chunks_mut::<6>().0;
                contact_wrenches(compiled, &s.state.contacts, h, &self.references, wrenches);
                wrenches[0] = [R::zero(); 6];
                // The torque comes before the force.
                wrenches.iter_mut().for_each(|wrench| wrench.rotate_left(3));
            }
            Q::ClosedEqualityData => self.closed_equalities(compiled, kinematics, &s.state.q),
            Q::TendonPaths => {
                for segment in compiled.paths.iter().flat_map(|path| &path.segments) {
                    self.values.extend(kinematics.points_of_segment(segment).as_flattened());
                }
            }
            Q::MassMatrix => self.values.extend(self.dynamics.mass_matrix(compiled, kinematics)),
            Q::BiasForce => {
                self.values.resize(compiled.nv, R::zero());
                self.dynamics.bias_force(compiled, kinematics, &s.state.v, &mut self.values);
            }
            Q::SmoothAcceleration => {
                let state = [&s.state.q[..], &s.state.v, &s.state.act];
                self.values.extend(self.dynamics.acceleration(compiled, kinematics, state, (&s.inputs, Some(&s.state.contacts), h)));
            }
            Q::BodyJacobian(body) => {
                let body = &compiled.bodies[body];
                self.jacobian(compiled, kinematics, body.frame, splat(body.pos));
            }
            Q::SiteJacobian(site) => {
                let site = &compiled.sensing.sites[site];
                self.jacobian(compiled, kinematics, site.frame, compiled.params.place(site.index));
            }
            Q::Acceleration | Q::JointConstraintForce | Q::ActuatorForce | Q::JointActuatorForce => unreachable!("returned above"),
        }
    }

    /// Computes the inertias of the bodies about the centres of mass of their kinematic trees into `values`, as MuJoCo's `cinert`.
    #[inline(always)]
    fn inertias(&mut self, compiled: &LaneModel<R>, kinematics: &Kinematics<R>) {
        self.find_references(compiled, kinematics);
        self.values.resize(10, R::zero());
        for b in 1..compiled.bodies.len() {
            let (mass, [xx, yy, zz, xy, xz, yz]) = (compiled.params.mass(b), compiled.params.body_inertia(b));
            let mat = &kinematics.mat[compiled.bodies[b].frame];
            let turned = mat_mul(mat, &[xx, xy, xz, xy, yy, yz, xz, yz, zz]);
            let about =
                |i: usize, j: usize| turned[3 * i] * mat[3 * j] + turned[3 * i + 1] * mat[3 * j + 1] + turned[3 * i + 2] * mat[3 * j + 2];
            let place = sub(self.centres[b], self.references[b]);
            let moment = scale(place, mass);
            let square = dot(place, moment);
            let entry = |i: usize, j: usize| about(i, j) - place[i] * moment[j];
            let diagonal = |i: usize| entry(i, i) + square;
            let [x, y, z] = moment;
            self.values.extend([diagonal(0), diagonal(1), diagonal(2), entry(0, 1), entry(0, 2), entry(1, 2), x, y, z, mass]);
        }
    }

    /// Computes the numbers with which every equality has no position error at the configuration `q`, into `values`, 11 per equality.
    #[inline(always)]
    fn closed_equalities(&mut self, compiled: &LaneModel<R>, kinematics: &Kinematics<R>, q: &[R]) {
        self.find_orientations(compiled, q);
        let equalities = compiled.equalities.iter().flat_map(|block| &block.equalities);
        self.values.resize(11 * equalities.clone().count(), R::zero());
        for equality in equalities {
            let numbers = compiled.params.equality(equality.index);
            let mut row = [R::zero(); 11];
            match &equality.rows {
                EqualityRows::Points { frames, bodies, turn, .. } => {
                    let welded = turn.is_some();
                    let point =
                        if welded { kinematics.point(frames[1], numbers.second) } else { kinematics.point(frames[0], numbers.first) };
                    let quats = [self.orientation_of(compiled, bodies[0]), self.orientation_of(compiled, bodies[1])];
                    for side in 0..2 {
                        let body = &compiled.bodies[bodies[side]];
                        let arm = sub(point, kinematics.point(body.frame, splat(body.pos)));
                        let anchor = rotate_back(&quat_to_mat(quats[side]), arm);
                        // A weld has the anchor in the second body first.
                        let start = if (side == 1) == welded { 0 } else { 3 };
                        row[start..start + 3].copy_from_slice(&anchor);
                    }
                    if welded {
                        row[6..10].copy_from_slice(&quat_between(quats[0], quats[1]));
                        row[10] = numbers.weight;
                    }
                }
                EqualityRows::Coupling { first, second } => {
                    let error = coupling_error(first, second.as_ref(), numbers.polynomial, (q, &kinematics.paths));
                    row[..5].copy_from_slice(&numbers.polynomial);
                    row[0] += error;
                }
            }
            self.values[11 * equality.index..][..11].copy_from_slice(&row);
        }
    }

    /// Orientation of body `body`, a quaternion (w, x, y, z). The orientations of the frames must be computed.
    #[inline(always)]
    fn orientation_of(&self, compiled: &LaneModel<R>, body: usize) -> [R; 4] {
        let body = &compiled.bodies[body];
        quat_mul(self.orientation[body.frame], splat(body.quat))
    }

    /// Computes the orientations of the frames, unless they are cached.
    #[inline(always)]
    fn find_orientations(&mut self, compiled: &LaneModel<R>, q: &[R]) {
        if !self.cached.orientations {
            orientations(compiled, q, &mut self.orientation);
            self.cached.orientations = true;
        }
    }

    /// Computes the spatial velocities of the links, unless they are cached.
    #[inline(always)]
    fn find_velocities(&mut self, compiled: &LaneModel<R>, kinematics: &Kinematics<R>, v: &[R]) {
        if !self.cached.velocities {
            self.velocity.resize(compiled.links.len(), zero());
            kinematics.velocities(compiled, v, &mut self.velocity);
            self.cached.velocities = true;
        }
    }

    /// Computes the centres of mass of the bodies in the world frame, unless they are cached.
    #[inline(always)]
    fn find_centres(&mut self, compiled: &LaneModel<R>, kinematics: &Kinematics<R>) {
        if !self.cached.centres {
            self.centres.resize(compiled.bodies.len(), zero());
            for (b, (out, body)) in self.centres.iter_mut().zip(&compiled.bodies).enumerate() {
                *out = kinematics.point(body.frame, compiled.params.body_com(b));
            }
            self.cached.centres = true;
        }
    }

    /// Computes the centres of mass of the bodies, of the bodies with their descendants, and of their trees. A tree begins at a child of
    /// the world.
    #[inline(always)]
    fn find_references(&mut self, compiled: &LaneModel<R>, kinematics: &Kinematics<R>) {
        if self.cached.references {
            return;
        }
        self.cached.references = true;
        self.find_centres(compiled, kinematics);
        let n = compiled.bodies.len();
        self.subtrees.resize(n, zero());
        self.mass.resize(n, R::zero());
        let (out, mass, own) = (&mut self.subtrees[..n], &mut self.mass[..n], &self.centres[..n]);
        for b in 0..n {
            mass[b] = compiled.params.mass(b);
            out[b] = scale(own[b], mass[b]);
        }
        for b in (0..n).rev() {
            let (parent, whole) = (compiled.bodies[b].parent, mass[b]);
            if b > 0 {
                mass[parent] += whole;
                out[parent] = add(out[parent], out[b]);
            }
            let heavy = whole.gt(R::of(MIN_VALUE));
            let centre = scale(out[b], R::one() / R::select(heavy, whole, R::one()));
            out[b] = select(heavy, centre, own[b]);
        }
        self.references.clear();
        for (b, body) in compiled.bodies.iter().enumerate() {
            let reference = if body.parent == 0 { self.subtrees[b] } else { self.references[body.parent] };
            self.references.push(reference);
        }
    }

    /// Computes the Jacobian of the point `local` of a frame into `values`.
    #[inline(always)]
    fn jacobian(&mut self, compiled: &LaneModel<R>, kinematics: &Kinematics<R>, frame: usize, local: V3<R>) {
        let nv = compiled.nv;
        self.values.resize(6 * nv, R::zero());
        let point = kinematics.point(frame, local);
        for d in 0..nv {
            if compiled.moved_dofs[frame][d / 64] >> (d % 64) & 1 == 0 {
                continue;
            }
            let axis = &kinematics.axes[d];
            let (turning, moving) = (angular(axis), velocity_at(axis, sub(point, kinematics.origin[compiled.dofs[d].tree])));
            for k in 0..3 {
                self.values[k * nv + d] = moving[k];
                self.values[(3 + k) * nv + d] = turning[k];
            }
        }
    }
}

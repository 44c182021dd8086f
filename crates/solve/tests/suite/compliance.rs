//! Tests of compliant normal rows. A compliance is equivalent to a hard row with an additional coordinate for the spring.

use crate::common::{Share, cases};
use proptest::prelude::*;
use stepper_real::{F32Lanes, Mask, Real};
use stepper_solve::newton::Newton;
use stepper_solve::{Capacity, Iterate, LoadedProblem, Problem, Settings, residual, solve};

type R32 = F32Lanes;

/// Number of coordinates of the bodies.
const N: usize = 10;

/// Random problem of contacts with three rows and one contact with six rows. All have entries at every coordinate, and a compliance.
#[derive(Clone, Debug)]
struct Case {
    sliding: Vec<(Vec<[f64; 3]>, [f64; 3], f64)>,
    rolling: (Vec<[f64; 6]>, [f64; 6], f64),
    mu: f64,
}

fn case() -> impl Strategy<Value = Case> {
    // Compliances from that of steel to that of a sponge, in units of the contact's mobility.
    let compliance = || prop_oneof![1 => Just(0.0), 4 => (-6.0..4.0_f64).prop_map(|x| 10.0_f64.powf(x))];
    let speed = || -1.0..1.0_f64;
    let sliding = (prop::collection::vec(prop::array::uniform3(-1.0..1.0), N), prop::array::uniform3(speed()), compliance());
    let rolling = (prop::collection::vec(prop::array::uniform6(-1.0..1.0), N), prop::array::uniform6(speed()), compliance());
    (prop::collection::vec(sliding, 1..4), rolling, 0.0..1.0).prop_map(|(sliding, rolling, mu)| Case { sliding, rolling, mu })
}

/// Problem of a case. If `springs_as_coordinates`, each contact has an additional coordinate for its spring, instead of a compliance.
fn build<R: Real>(case: &Case, springs_as_coordinates: bool) -> (Problem<R>, Iterate<R>) {
    let contacts = case.sliding.len();
    let mut capacity = Capacity::of_coordinates(N + contacts + 1);
    (capacity.contacts, capacity.rolling_contacts, capacity.columns_per_contact) = (contacts, 1, N + 1);
    let (mut problem, mut iterate) = (Problem::new(&capacity), Iterate::new(&capacity));
    iterate.clear();
    let columns = |k: usize| -> Vec<u32> { (0..N as u32).chain(springs_as_coordinates.then_some((N + k) as u32)).collect() };
    for (k, (y, g, compliance)) in case.sliding.iter().enumerate() {
        let y = |c: usize| y.get(c).unwrap_or(&[compliance.sqrt(), 0.0, 0.0]).map(R::of);
        problem.push_contact(&columns(k), y, Mask::splat(true), R::of(case.mu), g.map(R::of));
        if !springs_as_coordinates {
            problem.contacts.set_compliance(R::of(*compliance));
        }
        iterate.contacts.extend([R::zero(); 3]);
    }
    let (y, g, compliance) = &case.rolling;
    let spring = [compliance.sqrt(), 0.0, 0.0, 0.0, 0.0, 0.0];
    let y = |c: usize| y.get(c).unwrap_or(&spring).map(R::of);
    problem.push_contact(&columns(contacts), y, Mask::splat(true), R::of(case.mu), g.map(R::of));
    if !springs_as_coordinates {
        problem.contacts.set_compliance(R::of(*compliance));
    }
    iterate.contacts.extend([R::zero(); 6]);
    iterate.compute_w(&problem);
    (problem, iterate)
}

#[test]
fn a_spring_is_a_coordinate_that_no_other_contact_sees() {
    for (sweeps, newton_steps) in [(20_000, 0), (2, 200)] {
        let solved = Share::default();
        proptest!(cases(300), |(case in case())| {
            let settings = Settings::new(sweeps, newton_steps, 1e-11);
            let (problem, mut iterate) = build::<f64>(&case, false);
            let outcome = solve(&problem, &mut iterate, settings, true, &mut Newton::default());
            // Impulses have a rounding error of 1e-16 of the largest. It changes velocities by up to ten times that (ten squares of at most
            // 1), and a few such errors add up.
            let impulses = iterate.contacts.iter();
            let largest = impulses.fold(1.0_f64, |most, x| most.max(x.abs()));
            let again = residual(&problem, &iterate);
            prop_assert!((outcome.residual - again).abs() <= 1e-14 * largest + 1e-13 * (1.0 + outcome.residual), "{} {again}", outcome.residual);
            prop_assume!(solved.count(outcome.residual <= 1e-11));
            // The impulses also solve the other problem, whose row velocities are the same numbers summed in another order. The residual of
            // the first problem counts only the fraction G_nn / (G_nn + R) of the error of a spring.
            let square = |y: f64| y * y;
            let normals = case.sliding.iter().map(|(y, _, r)| (y.iter().map(|y| square(y[0])).sum::<f64>(), *r));
            let rolling = (case.rolling.0.iter().map(|y| square(y[0])).sum::<f64>(), case.rolling.2);
            let softest = normals.chain([rolling]).fold(1.0, |most: f64, (g, r)| most.max((g + r) / g));
            let (other, mut again) = build::<f64>(&case, true);
            again.contacts.clone_from(&iterate.contacts);
            again.compute_w(&other);
            let most = again.w.iter().fold(1.0_f64, |most, x| most.max(x.abs()));
            prop_assert!(residual(&other, &again) <= softest * (1e-11 + 1e-13 * most), "{}", residual(&other, &again));
        });
        solved.at_least(if newton_steps == 0 { 0.5 } else { 0.9 }, "solved");
    }
}

#[test]
fn what_is_much_softer_than_bodies_are_heavy_is_solved_in_32_bits_too() {
    let solved = Share::default();
    proptest!(cases(300), |(case in case())| {
        // Eight rounding errors of a velocity of 1 m/s, as in the default tolerance of 32 bits.
        let settings = Settings::new(500, 0, R32::of(1.2e-6));
        let (problem, mut iterate) = build::<R32>(&case, false);
        let outcome = solve(&problem, &mut iterate, settings, Mask::splat(true), &mut Newton::default());
        let left = f64::from(outcome.residual.lane(0));
        prop_assert!(left.is_finite());
        solved.count(left <= 1e-5);
    });
    solved.at_least(0.9, "solved in 32 bits");
}

/// A quadruped has sunk into soft ground of 500 N/m. The compliance of its contacts is four hundred times the mobility of the bodies, and
/// the mobility decides whether a contact slides.
#[test]
fn what_slides_on_soft_ground_is_not_held_in_32_bits() {
    let file = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/problems_32_bits/quadruped_on_soft_ground.problem");
    let LoadedProblem { problem, mut iterate, settings } = Problem::<R32>::load(file).unwrap();
    let sweeps_alone = Settings { sweeps: 20, newton_steps: 0, ..settings };
    let outcome = solve(&problem, &mut iterate, sweeps_alone, Mask::splat(true), &mut Newton::default());
    assert!(outcome.residual.lane(0) <= settings.tolerance.lane(0), "{}", outcome.residual.lane(0));
}

//! Tests of contacts with six rows against the conditions that define their solution.

use crate::common::{Share, cases};
use proptest::prelude::*;
use stepper_solve::gauss_seidel::{SweepSettings, solve};
use stepper_solve::{Capacity, Iterate, Problem, cone, residual};

/// Contacts in `n` coordinates; some rows are zero (friction that a contact lacks) or short (rolling against sliding).
#[derive(Clone, Debug)]
struct Case {
    n: usize,
    y: Vec<Vec<[f64; 6]>>,
    mu: Vec<f64>,
    g: Vec<[f64; 6]>,
}

fn case() -> impl Strategy<Value = Case> {
    (1usize..4, 6usize..14).prop_flat_map(|(contacts, n)| {
        let y = prop::collection::vec(prop::collection::vec(prop::array::uniform6(-1.0..1.0), n), contacts);
        let mu = prop::collection::vec(0.05..1.5, contacts);
        let g = prop::collection::vec(prop::array::uniform6(-2.0..2.0), contacts);
        let weights = prop::collection::vec(prop::array::uniform6(prop_oneof![Just(0.0), Just(1e-3), 0.01..1.0]), contacts);
        (Just(n), y, mu, g, weights).prop_map(|(n, mut y, mu, mut g, weights)| {
            for k in 0..y.len() {
                for i in 1..6 {
                    y[k].iter_mut().for_each(|row| row[i] *= weights[k][i]);
                    g[k][i] *= weights[k][i];
                }
            }
            Case { n, y, mu, g }
        })
    })
}

fn build(case: &Case) -> (Problem<f64>, Iterate<f64>) {
    let contacts = case.y.len();
    let capacity = Capacity { dimension: case.n, rolling_contacts: contacts, columns_per_contact: case.n, ..Capacity::default() };
    let (mut problem, mut iterate) = (Problem::new(&capacity), Iterate::new(&capacity));
    let columns: Vec<u32> = (0..case.n as u32).collect();
    for k in 0..contacts {
        problem.push_contact(&columns, |i| case.y[k][i], true, case.mu[k], case.g[k]);
        iterate.contacts.extend([0.0; 6]);
    }
    iterate.compute_w(&problem);
    (problem, iterate)
}

/// Velocity of contact k, computed from w = Y lambda with the full matrix Y.
fn velocity(case: &Case, iterate: &Iterate<f64>, k: usize) -> [f64; 6] {
    let mut w = vec![0.0; case.n];
    for (y, lambda) in case.y.iter().zip(iterate.contacts.as_chunks::<6>().0) {
        for (w, y) in w.iter_mut().zip(y) {
            *w += y.iter().zip(lambda).map(|(y, l)| y * l).sum::<f64>();
        }
    }
    std::array::from_fn(|i| case.g[k][i] + case.y[k].iter().zip(&w).map(|(y, w)| y[i] * w).sum::<f64>())
}

fn length(x: &[f64]) -> f64 {
    x.iter().map(|x| x * x).sum::<f64>().sqrt()
}

proptest! {
    #![proptest_config(cases(400))]

    #[test]
    fn a_single_contact_is_solved_by_one_sweep(case in case()) {
        let one = Case { y: vec![case.y[0].clone()], mu: vec![case.mu[0]], g: vec![case.g[0]], ..case };
        let (problem, mut iterate) = build(&one);
        let outcome = solve(&problem, &mut iterate, SweepSettings { sweeps: 1, tolerance: 1e-9 }, true);
        // The tolerance covers the rounding of G, and the error of Jacobi's method in rows that are short compared with the others. An
        // immovable direction also moves under the impulse of the first sweep, because its mobility counts as 1e-8 of the trace.
        let trace: f64 = one.y[0].iter().flatten().map(|y| y * y).sum();
        let least = 1e-8 * trace * length(&iterate.contacts);
        prop_assert!(outcome.residual < 1e-8 + least, "residual {}", outcome.residual);
    }

    #[test]
    fn projection_is_the_nearest_point_of_the_cone(x in prop::array::uniform6(-2.0..2.0f64), mu in 0.0..2.0f64, other in prop::array::uniform6(-2.0..2.0f64)) {
        let p = cone::project(x, mu);
        let distance = |a: &[f64; 6], b: &[f64; 6]| a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
        prop_assert!(length(&p[1..]) <= mu * p[0] + 1e-12, "not in the cone");
        let mut inside = other;
        inside[0] = other[0].abs();
        let shrink = (mu * inside[0] / length(&other[1..]).max(1e-300)).min(1.0);
        inside[1..].iter_mut().for_each(|x| *x *= shrink);
        prop_assert!(distance(&x, &p) <= distance(&x, &inside) + 1e-12);
    }
}

#[test]
fn solutions_satisfy_the_law() {
    let solved = Share::default();
    proptest!(cases(400), |(case in case())| {
        let (problem, mut iterate) = build(&case);
        let outcome = solve(&problem, &mut iterate, SweepSettings { sweeps: 20_000, tolerance: 1e-11 }, true);
        prop_assume!(solved.count(outcome.residual <= 1e-11));
        let size = 1.0 + iterate.contacts.iter().fold(0.0f64, |m, x| m.max(x.abs()));
        // The natural map bounds each condition by its residual, times the scale of G (about 100 at the most) and of the impulses.
        let tolerance = 1e-8 * size;
        for (k, lambda) in iterate.contacts.as_chunks::<6>().0.iter().enumerate() {
            let (v, mu) = (velocity(&case, &iterate, k), case.mu[k]);
            let (pull, slip) = (length(&lambda[1..]), length(&v[1..]));
            prop_assert!(lambda[0] >= 0.0 && v[0] >= -tolerance, "separation {} impulse {}", v[0], lambda[0]);
            prop_assert!((lambda[0] * v[0]).abs() <= tolerance * size, "complementarity {}", lambda[0] * v[0]);
            prop_assert!(pull <= mu * lambda[0] + 1e-12 * size, "cone: {pull} of {}", mu * lambda[0]);
            // Maximum dissipation: lambda_t . v_t = -mu lambda_n |v_t|.
            let power: f64 = lambda[1..].iter().zip(&v[1..]).map(|(l, v)| l * v).sum();
            prop_assert!((power + mu * lambda[0] * slip).abs() <= tolerance * (1.0 + slip), "power {power}, slip {slip}");
        }
    });
    // Sweeps cycle now and then where friction is strong: 0.04 % of 20,000 draws.
    solved.at_least(0.999, "solved");
}

#[test]
fn the_residual_sees_every_defect() {
    let solved = Share::default();
    proptest!(cases(400), |(case in case(), push in prop_oneof![-0.5..-0.01, 0.01..0.5])| {
        let (problem, mut iterate) = build(&case);
        let outcome = solve(&problem, &mut iterate, SweepSettings { sweeps: 20_000, tolerance: 1e-10 }, true);
        prop_assume!(solved.count(outcome.residual <= 1e-10));
        iterate.contacts[0] += push;
        iterate.compute_w(&problem);
        prop_assert!(residual(&problem, &iterate) > 1e-6);
    });
    // With this looser tolerance 0.02 % of 20,000 draws remain unsolved.
    solved.at_least(0.999, "solved");
}

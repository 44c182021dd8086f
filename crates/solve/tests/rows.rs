//! Scalar rows: equalities made orthogonal, and compliance.

use proptest::prelude::*;
use stepper_solve::pgs::{Settings, solve};
use stepper_solve::{Iterate, Problem, residual};

const FREE: [f64; 2] = [f64::NEG_INFINITY, f64::INFINITY];

/// Equalities y . w + g = 0 in `n` coordinates; the last is the sum of the others, so that it asks for nothing new.
fn equalities() -> impl Strategy<Value = (usize, Vec<Vec<f64>>, Vec<f64>)> {
    (1usize..6, 6usize..9).prop_flat_map(|(rows, n)| {
        let y = prop::collection::vec(prop::collection::vec(-1.0..1.0f64, n), rows);
        let g = prop::collection::vec(-2.0..2.0f64, rows);
        (Just(n), y, g).prop_map(|(n, mut y, mut g)| {
            y.push((0..n).map(|i| y.iter().map(|r| r[i]).sum()).collect());
            g.push(g.iter().sum());
            (n, y, g)
        })
    })
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

proptest! {
    #[test]
    fn one_sweep_solves_orthogonal_equalities_and_drops_dependent_ones((n, y, g) in equalities()) {
        let rows = y.len();
        let mut problem = Problem::with_capacity(n, rows, 0);
        let mut iterate = Iterate::with_capacity(n, rows, 0);
        let support: Vec<u32> = (0..n as u32).collect();
        for (y, &g) in y.iter().zip(&g) {
            problem.push_scalar(&support, |i| y[i], 1.0, true, g, FREE);
            iterate.scalars.push(0.0);
        }
        let sizes: Vec<f64> = y.iter().map(|y| dot(y, y)).collect();
        let mut also: Vec<[f64; 2]> = g.iter().map(|&g| [g, -g]).collect();
        problem.orthogonalise(0..rows, &sizes, &mut also);
        iterate.start(&problem);
        let outcome = solve(&problem, &mut iterate, Settings { sweeps: 1, tolerance: 1e-9 }, true);
        let kept = problem.scalars.iter().filter(|r| r.active).count();
        prop_assert!(kept < rows, "the dependent row is still there");
        prop_assert!(outcome.residual < 1e-9, "residual {}", outcome.residual);
        for (k, (y, &g)) in y.iter().zip(&g).enumerate() {
            // Rounding, divided by the sine between nearly dependent rows (1e-4 at the least in so few cases), twice.
            prop_assert!((dot(y, &iterate.w) + g).abs() < 1e-8, "row {k}: {}", dot(y, &iterate.w) + g);
        }
        for (row, also) in problem.scalars.iter().zip(&also) {
            prop_assert_eq!([row.g, -row.g], *also);
        }
    }

    #[test]
    fn a_compliant_row_gives_way_in_proportion_to_its_impulse(y in prop::collection::vec(-1.0..1.0f64, 3), g in -2.0..2.0f64, r in 0.0..10.0f64) {
        prop_assume!(dot(&y, &y) > 1e-3);
        let mut problem = Problem::with_capacity(3, 1, 0);
        let mut iterate = Iterate::with_capacity(3, 1, 0);
        problem.push_scalar(&[0, 1, 2], |i| y[i], 1.0, true, g, FREE);
        problem.soften(r);
        iterate.scalars.push(0.0);
        iterate.start(&problem);
        let outcome = solve(&problem, &mut iterate, Settings { sweeps: 1, tolerance: 1e-12 }, true);
        prop_assert!((iterate.scalars[0] + g / (dot(&y, &y) + r)).abs() < 1e-12 * (1.0 + g.abs() / (dot(&y, &y) + r)));
        prop_assert!(outcome.residual < 1e-12);
        iterate.scalars[0] += 0.1;
        iterate.start(&problem);
        prop_assert!((residual(&problem, &iterate) - 0.1 * (dot(&y, &y) + r)).abs() < 1e-12 * (1.0 + r));
    }
}

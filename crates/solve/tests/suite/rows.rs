//! Tests of scalar rows: orthogonal equality rows, their elimination from other rows, and compliance.

use crate::common::{capacity, cases};
use proptest::prelude::*;
use stepper_real::{F32Lanes, Mask, Real};
use stepper_solve::gauss_seidel::{SweepSettings, solve};
use stepper_solve::{EntryScales, Iterate, Problem, RowScales, residual};

const FREE: [f64; 2] = [f64::NEG_INFINITY, f64::INFINITY];

/// Equalities y . w + g = 0 in `n` coordinates; the last is the sum of the others, so that it adds no condition.
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

/// For each row, whether it remains after all rows have been made orthogonal. Coordinate i has a mass of `10^decades[i]`.
fn independent<R: Real>(jacobian: &[Vec<f64>], decades: &[f64]) -> Vec<bool> {
    let (rows, n) = (jacobian.len(), jacobian[0].len());
    let mut problem = Problem::<R>::new(&capacity(n, rows, 0));
    let columns: Vec<u32> = (0..n as u32).collect();
    let entry = |x: f64, i: usize| R::of(x) * R::of(10f64.powf(-0.5 * decades[i]));
    let (mut lengths, mut entries) = (Vec::new(), Vec::new());
    for y in jacobian {
        problem.scalars.push(&columns, |i| entry(y[i], i), R::one(), R::Mask::splat(true), R::zero(), FREE.map(R::of));
        let squares: Vec<R> = (0..n).map(|i| entry(y[i], i).square()).collect();
        lengths.push(squares.iter().fold(R::zero(), |sum, &x| sum + x));
        entries.extend(squares);
    }
    let scales = RowScales {
        lengths: &lengths,
        velocities: &mut vec![R::one(); rows],
        entries: Some(EntryScales { squares: &mut entries, coefficients: &mut vec![R::zero(); rows] }),
    };
    assert!(problem.scalars.orthogonalise::<1>(0..rows, scales, &mut vec![[R::zero()]; rows], |_, _| {}));
    problem.scalars.iter().map(|row| row.active.bits() & 1 == 1).collect()
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

proptest! {
    #![proptest_config(cases(256))]

    #[test]
    fn one_sweep_solves_orthogonal_equalities_and_drops_dependent_ones((n, y, g) in equalities()) {
        let rows = y.len();
        let mut problem = Problem::new(&capacity(n, rows, 0));
        let mut iterate = Iterate::new(&capacity(n, rows, 0));
        let columns: Vec<u32> = (0..n as u32).collect();
        for (y, &g) in y.iter().zip(&g) {
            problem.scalars.push(&columns, |i| y[i], 1.0, true, g, FREE);
            iterate.scalars.push(0.0);
        }
        let sizes: Vec<f64> = y.iter().map(|y| dot(y, y)).collect();
        let mut also: Vec<[f64; 2]> = g.iter().map(|&g| [g, -g]).collect();
        let mut entries: Vec<f64> = y.iter().flatten().map(|y| y * y).collect();
        // Without the scales of the entries, the call finds the dependent row and returns false, because it cannot decide.
        let blind = RowScales { lengths: &sizes, velocities: &mut vec![1.0; rows], entries: None };
        prop_assert!(!problem.clone().scalars.orthogonalise(0..rows, blind, &mut also.clone(), |_, _| ()));
        let entries = Some(EntryScales { squares: &mut entries, coefficients: &mut vec![0.0; rows] });
        let scales = RowScales { lengths: &sizes, velocities: &mut vec![1.0; rows], entries };
        prop_assert!(problem.scalars.orthogonalise(0..rows, scales, &mut also, |_, _| ()));
        iterate.compute_w(&problem);
        let outcome = solve(&problem, &mut iterate, SweepSettings { sweeps: 1, tolerance: 1e-9 }, true);
        let kept = problem.scalars.iter().filter(|r| r.active).count();
        prop_assert!(kept < rows, "the dependent row is still there");
        prop_assert!(outcome.residual < 1e-9, "residual {}", outcome.residual);
        for (k, (y, &g)) in y.iter().zip(&g).enumerate() {
            // The error is rounding divided twice by the sine of the angle between nearly dependent rows (at least 1e-4 in so few cases).
            prop_assert!((dot(y, &iterate.w) + g).abs() < 1e-8, "row {k}: {}", dot(y, &iterate.w) + g);
        }
        for (row, also) in problem.scalars.iter().zip(&also) {
            prop_assert_eq!([row.g, -row.g], *also);
        }
    }

    /// Only rows that are sums of other rows are removed, in both precisions, even if the masses differ by a factor of 1e9.
    #[test]
    fn masses_make_no_row_dependent(
        (n, y, _) in equalities(),
        decades in prop::collection::vec(0.0..9.0f64, 9),
        signs in prop::collection::vec(prop_oneof![Just(0.0), Just(1.0)], 9 * 6),
        others in prop::collection::vec(any::<bool>(), 5),
    ) {
        let some: Vec<bool> = std::iter::once(true).chain(others).collect();
        // Sparse rows, as of bodies in a chain, each with one exclusive coordinate, so that all but the last are independent.
        let rows = y.len() - 1;
        let mut jacobian: Vec<Vec<f64>> = (0..rows).map(|k| (0..n).map(|i| y[k][i] * signs[k * 9 + i]).collect()).collect();
        for (k, row) in jacobian.iter_mut().enumerate() {
            for (i, x) in row.iter_mut().enumerate().take(rows) {
                *x = if i == k { 1.0 + x.abs() } else if i > k { 0.0 } else { *x };
            }
        }
        // The last row is the sum of the first and some of the other rows.
        jacobian.push((0..n).map(|i| jacobian.iter().zip(&some).filter(|(_, some)| **some).map(|(r, _)| r[i]).sum()).collect());
        prop_assert_eq!(independent::<f64>(&jacobian, &decades), vec![true; rows].into_iter().chain([false]).collect::<Vec<_>>());
        prop_assert_eq!(independent::<F32Lanes>(&jacobian, &decades), vec![true; rows].into_iter().chain([false]).collect::<Vec<_>>());
    }

    #[test]
    fn what_separate_rows_hold_is_taken_out_of_a_limit_once_for_all((n, y, g) in equalities(), limit in prop::collection::vec(-1.0..1.0f64, 9), free in -2.0..2.0f64) {
        let rows = y.len();
        let columns: Vec<u32> = (0..n as u32).collect();
        let sizes: Vec<f64> = y.iter().map(|y| dot(y, y)).collect();
        let limits = [0.0, f64::INFINITY];
        let [mut together, mut apart] = [(); 2].map(|()| {
            let mut problem = Problem::new(&capacity(n, rows + 1, 0));
            for (y, &g) in y.iter().zip(&g) {
                problem.scalars.push(&columns, |i| y[i], 1.0, true, g, FREE);
            }
            let mut entries: Vec<f64> = y.iter().flatten().map(|y| y * y).collect();
            let entries = Some(EntryScales { squares: &mut entries, coefficients: &mut vec![0.0; rows] });
            let scales = RowScales { lengths: &sizes, velocities: &mut vec![1.0; rows], entries };
            assert!(problem.scalars.orthogonalise::<1>(0..rows, scales, &mut vec![[0.0]; rows], |_, _| {}));
            problem
        });
        together.scalars.push(&columns, |i| limit[i], 1.0, true, free, limits);
        let (mut rest, mut target) = (limit.clone(), free);
        for row in apart.scalars.iter() {
            let (_, entries) = apart.scalars.entries(row);
            let share = row.projection(dot(entries, &rest[..n]));
            entries.iter().zip(&mut rest).for_each(|(y, x)| *x -= share * y);
            target -= share * row.g;
        }
        let (whole, left) = (dot(&limit[..n], &limit[..n]), dot(&rest[..n], &rest[..n]));
        prop_assume!(left > 1e-2 * whole);
        apart.scalars.mark_eliminated();
        apart.scalars.push(&columns, |i| rest[i], 1.0, true, target, limits);
        apart.scalars.set_mobility_ratio(whole / left);
        // One sweep is enough if the equalities are eliminated. Otherwise sweeps alternate between the equalities and the limit.
        let [one, many] = [(&apart, 1), (&together, 20_000)].map(|(problem, sweeps)| {
            let mut iterate = Iterate::new(&capacity(n, rows + 1, 0));
            iterate.scalars.extend(vec![0.0; rows + 1]);
            iterate.compute_w(problem);
            let outcome = solve(problem, &mut iterate, SweepSettings { sweeps, tolerance: 1e-12 }, true);
            (iterate, outcome)
        });
        // The error is rounding divided twice by the sine of the angle between nearly dependent rows. w is proportional to one over that
        // sine, so an error of some 1e-16 w^2 is expected: 1.7e-10 for the stored seed, whose w is 577.
        let largest = one.0.w.iter().fold(1.0, |most: f64, w| most.max(w.abs()));
        prop_assert!(one.1.residual < 1e-12 * largest, "residual {} of {largest}", one.1.residual);
        prop_assert!(many.1.residual < 1e-9, "residual {}", many.1.residual);
        // Both ways give the same w and the same impulse of the limit. The errors are residuals divided by the squared length `left`, which
        // is above 1e-2 for a row of order one.
        let scale = 1.0 + g.iter().fold(free.abs(), |most, g| most.max(g.abs()));
        prop_assert!((one.0.scalars[rows] - many.0.scalars[rows]).abs() * left < 1e-6 * scale);
        for (a, b) in one.0.w.iter().zip(&many.0.w) {
            prop_assert!((a - b).abs() < 1e-4 * scale, "{a} or {b}");
        }
    }

    #[test]
    fn a_compliant_row_gives_way_in_proportion_to_its_impulse(y in prop::collection::vec(-1.0..1.0f64, 3), g in -2.0..2.0f64, r in 0.0..10.0f64) {
        prop_assume!(dot(&y, &y) > 1e-3);
        let mut problem = Problem::new(&capacity(3, 1, 0));
        let mut iterate = Iterate::new(&capacity(3, 1, 0));
        problem.scalars.push(&[0, 1, 2], |i| y[i], 1.0, true, g, FREE);
        problem.scalars.set_compliance(r);
        iterate.scalars.push(0.0);
        iterate.compute_w(&problem);
        let outcome = solve(&problem, &mut iterate, SweepSettings { sweeps: 1, tolerance: 1e-12 }, true);
        prop_assert!((iterate.scalars[0] + g / (dot(&y, &y) + r)).abs() < 1e-12 * (1.0 + g.abs() / (dot(&y, &y) + r)));
        prop_assert!(outcome.residual < 1e-12);
        iterate.scalars[0] += 0.1;
        iterate.compute_w(&problem);
        prop_assert!((residual(&problem, &iterate) - 0.1 * (dot(&y, &y) + r)).abs() < 1e-12 * (1.0 + r));
    }
}

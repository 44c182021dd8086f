//! Tests that the solvers stay within their limits of steps and sweeps for any numbers, also infinite ones and NaN.

use crate::common::{capacity, cases};
use proptest::prelude::*;
use stepper_real::{F64Lanes, Mask, Real};
use stepper_solve::newton::{Newton, STEPS_RATIO, Search, Work};
use stepper_solve::{Iterate, PASSES, Problem, Settings, residual, solve};

const STEPS: u32 = 50;
const ROWS: usize = 6;
const N: usize = 9;

/// Random problem with a limit and contacts, whose rows use all coordinates or are in two islands.
#[derive(Clone, Debug)]
struct Case {
    /// Jacobian entries: `N` for the limit, then three times `N` for each contact.
    y: Vec<f64>,
    g: Vec<f64>,
    mu: f64,
    /// Factor of the Jacobian entries at each coordinate.
    scale: Vec<f64>,
    apart: bool,
}

impl Case {
    /// Whether a row has an entry at coordinate `c`. If `apart`, no row with an even number shares a coordinate with a row with an odd
    /// number.
    fn touches(&self, row: usize, c: usize) -> bool {
        !self.apart || row.is_multiple_of(2) == (c < N / 2)
    }
}

/// Random problems whose coordinates have scales from 10^-`decades` to 10^`decades`. The strategy `odd` draws about one in ten of the
/// Jacobian entries and velocities.
fn case(decades: f64, odd: impl Strategy<Value = f64> + Clone + 'static) -> impl Strategy<Value = Case> {
    let entry = prop_oneof![2 => Just(0.0), 12 => -1.0..1.0, 1 => odd.clone()];
    let speed = prop_oneof![8 => -2.0..2.0, 1 => odd];
    let scale = prop::collection::vec((-1.0..1.0f64).prop_map(move |x| 10f64.powf(decades * x)), N);
    let y = prop::collection::vec(entry, N + 3 * N * (ROWS - 1));
    let g = prop::collection::vec(speed, 1 + 3 * (ROWS - 1));
    (y, g, prop_oneof![Just(0.0), 0.0..1.5], scale, any::<bool>()).prop_map(|(y, g, mu, scale, apart)| Case { y, g, mu, scale, apart })
}

fn build<R: Real<Scalar = f64>>(case: &Case) -> (Problem<R>, Iterate<R>) {
    let (mut problem, mut iterate) = (Problem::new(&capacity(N, 1, ROWS)), Iterate::new(&capacity(N, 1, ROWS)));
    let columns = |row: usize| (0..N as u32).filter(|&c| case.touches(row, c as usize)).collect::<Vec<_>>();
    let y = |at: usize, c: usize| R::of(case.y[at + c] * case.scale[c]);
    let all = R::Mask::splat(true);
    problem.scalars.push(&columns(0), |c| y(0, c), R::one(), all, R::of(case.g[0]), [R::zero(), R::of(f64::INFINITY)]);
    iterate.scalars.push(R::zero());
    for k in 1..ROWS {
        let at = N + 3 * N * (k - 1);
        let g: [R; 3] = std::array::from_fn(|r| R::of(case.g[1 + 3 * (k - 1) + r]));
        problem.push_contact(&columns(k), |c| std::array::from_fn(|r| y(at + r * N, c)), all, R::of(case.mu), g);
        iterate.contacts.extend([R::zero(); 3]);
    }
    iterate.compute_w(&problem);
    (problem, iterate)
}

/// Fails if Newton's method made more steps or rounds than the limit `steps` allows.
fn check(work: Work, steps: u32) -> Result<(), TestCaseError> {
    prop_assert!(work.steps <= steps * work.islands, "{work:?}");
    prop_assert!(work.rounds <= steps * work.islands, "{work:?}");
    Ok(())
}

/// Solves a problem by Newton's method alone, for any impulses and for those of least norm, and checks the numbers of steps and rounds.
fn search(case: &Case, tolerance: f64) -> Result<(), TestCaseError> {
    for least_norm in [false, true] {
        let (problem, mut iterate) = build::<f64>(case);
        let (mut left, mut taken) = (residual(&problem, &iterate), 0.0);
        let before = left;
        let mut newton = Newton::default();
        let outcome = [&mut left, &mut taken];
        newton.solve(&problem, &mut iterate, Search { steps: STEPS, tolerance, least_norm }, true, outcome);
        let most = STEPS_RATIO * STEPS;
        check(newton.work(), most)?;
        prop_assert!(taken <= f64::from(most * newton.work().islands));
        prop_assert!(!left.is_nan() || before.is_nan(), "{before} became no number");
    }
    Ok(())
}

/// Random numbers of any magnitude, infinity and NaN.
fn odd() -> impl Strategy<Value = f64> + Clone {
    let size = (-300.0..300.0f64).prop_map(|x| 10f64.powf(x));
    prop_oneof![Just(f64::NAN), Just(f64::INFINITY), Just(-1e300), Just(1e-60), Just(5e-324), size]
}

proptest! {
    #![proptest_config(cases(400))]

    /// The search ends although rounding makes these tolerances impossible: when there is no progress, or after the largest number of
    /// rounds.
    #[test]
    fn a_tolerance_out_of_reach_ends(case in case(0.0, Just(1.0)), tolerance in prop_oneof![Just(1e-14), Just(1e-17), Just(1e-30), Just(0.0)]) {
        search(&case, tolerance)?;
    }

    /// The search also ends if the scales of the coordinates differ by many decades. Bodies whose sizes differ by three decades have masses
    /// that differ by nine.
    #[test]
    fn masses_over_decades_end(case in case(9.0, Just(1.0)), tolerance in prop_oneof![Just(1e-6), Just(1e-14)]) {
        search(&case, tolerance)?;
    }

    #[test]
    fn numbers_of_any_size_end(case in case(30.0, odd())) {
        search(&case, 1e-6)?;
    }

    /// The residual of a lane is NaN if the offset of any of its constraints is.
    #[test]
    fn the_residual_shows_a_nan_of_any_constraint(case in case(0.0, Just(1.0)), at in 0..ROWS) {
        // The solver leaves out rows without an entry.
        let first = if at == 0 { 0 } else { N + 3 * N * (at - 1) };
        prop_assume!((0..N).any(|c| case.touches(at, c) && case.y[first + c] != 0.0));
        let (mut problem, iterate) = build::<F64Lanes>(&case);
        match at {
            0 => problem.scalars[0].g.set_lane(3, f64::NAN),
            k => problem.contacts.offsets_mut(k - 1)[0].set_lane(3, f64::NAN),
        }
        prop_assert!(residual(&problem, &iterate).lane(3).is_nan());
    }

    /// Sweeps stay within their limit, and a diverging lane does not change the bits of other lanes.
    #[test]
    fn a_lane_that_blows_up_costs_its_neighbours_nothing_but_bounded_time(case in case(0.0, Just(1.0)), at in 0..ROWS, bad in odd()) {
        let (problem, iterate) = build::<F64Lanes>(&case);
        let mut worse = problem.clone();
        match at {
            0 => worse.scalars[0].g.set_lane(3, bad),
            k => worse.contacts.offsets_mut(k - 1)[0].set_lane(3, bad),
        }
        let settings = Settings::new(20, STEPS, F64Lanes::of(1e-9));
        let run = |problem: &Problem<F64Lanes>| {
            let (mut iterate, mut newton) = (iterate.clone(), Newton::default());
            let outcome = solve(problem, &mut iterate, settings, Mask::splat(true), &mut newton);
            (outcome, iterate, newton.work())
        };
        let (well, ill) = (run(&problem), run(&worse));
        check(ill.2, STEPS_RATIO * STEPS)?;
        for l in 0..F64Lanes::LANES {
            prop_assert!(ill.0.sweeps.lane(l) <= (20 * PASSES) as f64);
            if l != 3 {
                prop_assert_eq!(well.0.residual.lane(l).to_bits(), ill.0.residual.lane(l).to_bits());
                prop_assert!(well.1.w.iter().zip(&ill.1.w).all(|(a, b)| a.lane(l).to_bits() == b.lane(l).to_bits()));
            }
        }
    }
}

//! Tests of Newton's method against the conditions that define its solution, against sweeps, and on problems without a solution.

use crate::common::{Share, capacity, cases};
use proptest::prelude::*;
use stepper_real::{F32Lanes, F64Lanes, Mask, Real};
use stepper_solve::newton::{Newton, STEPS_RATIO, Search};
use stepper_solve::{Iterate, PASSES, Problem, Settings, gauss_seidel, residual, solve};

/// Rows of a problem: limits with one row, contacts with three.
#[derive(Clone, Debug)]
struct Case {
    n: usize,
    limits: Vec<(Vec<f64>, f64)>,
    contacts: Vec<Contact>,
}

#[derive(Clone, Debug)]
struct Contact {
    y: Vec<[f64; 3]>,
    mu: f64,
    g: [f64; 3],
}

/// Random problems with up to `most` - 1 contacts, not counting duplicates, and up to three limits. `mu` draws the friction coefficients.
/// Every row has entries at some coordinates, which are scaled by factors from 1 / `ratio` to 1 (roots of mass ratios). Some contacts come
/// twice.
fn case(most: usize, ratio: f64, mu: impl Strategy<Value = f64> + Clone + 'static) -> impl Strategy<Value = Case> {
    (1..most, 6usize..16).prop_flat_map(move |(contacts, n)| {
        let entry = prop_oneof![1 => Just(0.0), 2 => -1.0..1.0];
        let row = prop::collection::vec(prop::array::uniform3(entry.clone()), n);
        let contact = (row, mu.clone(), prop::array::uniform3(-2.0..2.0), prop::bool::weighted(0.2));
        let limit = (prop::collection::vec(entry, n), -1.0..1.0);
        let scale = prop::collection::vec((0.0..1.0f64).prop_map(move |x| ratio.powf(-x)), n);
        (prop::collection::vec(contact, contacts), prop::collection::vec(limit, 0..4), scale).prop_map(move |(contacts, limits, scale)| {
            let mut all = vec![];
            for (mut y, mu, g, twice) in contacts {
                y.iter_mut().zip(&scale).for_each(|(y, s)| *y = y.map(|y| y * s));
                let contact = Contact { y, mu, g };
                all.extend(std::iter::repeat_n(contact, 1 + usize::from(twice)));
            }
            let limits = limits.into_iter().map(|(y, g)| (y.iter().zip(&scale).map(|(y, s)| y * s).collect(), g)).collect();
            Case { n, limits, contacts: all }
        })
    })
}

/// Problem with one case in each lane, and an iterate without impulses. Lanes without a case have no rows.
fn build<R: Real>(cases: &[Case]) -> (Problem<R>, Iterate<R>) {
    let n = cases.iter().map(|c| c.n).max().unwrap();
    let most = |count: fn(&Case) -> usize| cases.iter().map(count).max().unwrap();
    let (limits, contacts) = (most(|c| c.limits.len()), most(|c| c.contacts.len()));
    let mut problem = Problem::new(&capacity(n, limits, contacts));
    let mut iterate = Iterate::new(&capacity(n, limits, contacts));
    problem.clear();
    iterate.clear();
    let columns: Vec<u32> = (0..n as u32).collect();
    let lanes = |number: &dyn Fn(&Case) -> Option<f64>| {
        let mut x = R::zero();
        cases.iter().enumerate().for_each(|(l, c)| x.set_lane(l, stepper_real::Scalar::from_f64(number(c).unwrap_or(0.0))));
        x
    };
    let active = |exists: &dyn Fn(&Case) -> bool| {
        R::Mask::from_bits(cases.iter().enumerate().fold(0, |bits, (l, c)| bits | u32::from(exists(c)) << l))
    };
    for k in 0..limits {
        let row = |c: &Case| c.limits.get(k).cloned();
        let y = |i: usize| lanes(&|c| row(c).and_then(|(y, _)| y.get(i).copied()));
        let bounds = [R::zero(), R::of(f64::INFINITY)];
        problem.scalars.push(&columns, y, R::one(), active(&|c| c.limits.len() > k), lanes(&|c| row(c).map(|(_, g)| g)), bounds);
        iterate.scalars.push(R::zero());
    }
    for k in 0..contacts {
        let of = |c: &Case| c.contacts.get(k).cloned();
        let y = |i: usize| std::array::from_fn(|r| lanes(&|c| of(c).and_then(|x| x.y.get(i).map(|y| y[r]))));
        let g: [R; 3] = std::array::from_fn(|r| lanes(&|c| of(c).map(|x| x.g[r])));
        problem.push_contact(&columns, y, active(&|c| c.contacts.len() > k), lanes(&|c| of(c).map(|x| x.mu)), g);
        iterate.contacts.extend([R::zero(); 3]);
    }
    iterate.compute_w(&problem);
    (problem, iterate)
}

/// Improves the impulses by Newton's method alone. Returns the residual, m/s, and the number of Newton steps.
fn newton(problem: &Problem<f64>, iterate: &mut Iterate<f64>, steps: u32, tolerance: f64) -> (f64, f64) {
    let (mut left, mut taken) = (residual(problem, iterate), 0.0);
    let search = Search { steps, tolerance, least_norm: false };
    Newton::default().solve(problem, iterate, search, true, [&mut left, &mut taken]);
    (left, taken)
}

fn bits(iterate: &Iterate<f64>) -> Vec<u64> {
    iterate.w.iter().chain(&iterate.scalars).chain(&iterate.contacts).map(|x| x.to_bits()).collect()
}

/// Largest difference between the scaled velocity changes w of two iterates.
fn apart(a: &Iterate<f64>, b: &Iterate<f64>) -> f64 {
    a.w.iter().zip(&b.w).fold(0.0, |most: f64, (a, b)| most.max((a - b).abs()))
}

proptest! {
    #![proptest_config(cases(300))]

    /// Each of eight problems of different sizes has the same bits in its lane as alone, after sweeps and Newton's method.
    #[test]
    fn lanes_have_the_bits_of_one(cases in prop::collection::vec(case(7, 1e1, 0.0..1.5), F64Lanes::LANES)) {
        let settings = Settings::new(3, 12, 1e-9);
        let (problem, mut iterate) = build::<F64Lanes>(&cases);
        let group_settings = Settings::new(3, 12, F64Lanes::of(1e-9));
        let outcome = solve(&problem, &mut iterate, group_settings, Mask::splat(true), &mut Newton::default());
        let mut newton = Newton::default();
        for (l, case) in cases.iter().enumerate() {
            let (problem, mut alone) = build::<f64>(std::slice::from_ref(case));
            let single = solve(&problem, &mut alone, settings, true, &mut newton);
            prop_assert_eq!(single.residual.to_bits(), outcome.residual.lane(l).to_bits());
            prop_assert_eq!((single.sweeps, single.newton_steps), (outcome.sweeps.lane(l), outcome.newton_steps.lane(l)));
            for (a, b) in alone.w.iter().zip(&iterate.w) {
                prop_assert_eq!(a.to_bits(), b.lane(l).to_bits());
            }
            for (a, b) in alone.contacts.as_chunks::<3>().0.iter().zip(iterate.contacts.as_chunks::<3>().0) {
                prop_assert_eq!(a.map(f64::to_bits), b.map(|b| b.lane(l).to_bits()));
            }
        }
    }

    /// In single precision the residual is that of the impulses after they have been rounded to 32 bits.
    #[test]
    fn single_precision_is_judged_as_it_is_returned(cases in prop::collection::vec(case(5, 1e1, 0.0..1.0), F32Lanes::LANES)) {
        let (problem, mut iterate) = build::<F32Lanes>(&cases);
        let settings = Settings::new(2, 40, F32Lanes::of(1e-4));
        let outcome = solve(&problem, &mut iterate, settings, Mask::splat(true), &mut Newton::default());
        let left = residual(&problem, &iterate);
        for l in 0..F32Lanes::LANES {
            let size = iterate.contacts.iter().chain(&iterate.scalars).fold(1.0f32, |m, x| m.max(x.lane(l).abs()));
            // Velocities are sums of some ten products of entries of order one with impulses.
            let rounding = 30.0 * f32::EPSILON * size;
            prop_assert!((left.lane(l) - outcome.residual.lane(l)).abs() <= rounding, "{} {}", left.lane(l), outcome.residual.lane(l));
        }
    }
}

/// Random problems with mass ratios up to 1e4, friction up to 1.5 and redundant rows may have no solution. Even then, Newton's method
/// returns the residual of the final impulses, which is no larger than that of the initial ones.
#[test]
fn what_is_returned_is_what_the_residual_says() {
    let solved = Share::default();
    proptest!(cases(300), |(case in case(9, 1e2, 0.0..1.5))| {
        let (problem, mut iterate) = build::<f64>(std::slice::from_ref(&case));
        let before = residual(&problem, &iterate);
        let (after, _) = newton(&problem, &mut iterate, 200, 1e-9);
        solved.count(after <= 1e-9);
        prop_assert!(iterate.w.iter().chain(&iterate.contacts).all(|x| x.is_finite()));
        // Sweeps and Newton's method add the same numbers up in different orders.
        prop_assert!(after <= before * (1.0 + 1e-14));
        // The iterate's w belongs to its impulses. Both residuals are therefore computed from the same numbers, summed in different orders.
        let size = 1.0 + bits(&iterate).iter().fold(0.0f64, |m, &x| m.max(f64::from_bits(x).abs()));
        prop_assert!((residual(&problem, &iterate) - after).abs() <= 1e-12 * size, "{} {after}", residual(&problem, &iterate));
        let w = iterate.w.clone();
        iterate.compute_w(&problem);
        for (a, b) in w.iter().zip(&iterate.w) {
            prop_assert!((a - b).abs() <= 1e-12 * size);
        }
    });
    // Problems with at least as many rows as coordinates often have no solution: 11.9 % of 30,000 draws remained unsolved.
    solved.at_least(0.87, "solved");
}

/// Without friction the problem is convex and w is unique. Newton's method solves it in any order of the rows, with the same result as
/// sweeps.
#[test]
fn without_friction_everything_is_solved_in_any_order() {
    let answered = Share::default();
    let swept_too = Share::default();
    proptest!(cases(300), |(case in case(9, 1e2, Just(0.0)), turn in 0usize..9)| {
        let (problem, mut iterate) = build::<f64>(std::slice::from_ref(&case));
        let (left, _) = newton(&problem, &mut iterate, 300, 1e-10);
        // If no motion satisfies all rows together, the problem has no solution.
        prop_assume!(answered.count(has_an_answer(&case)));
        // Velocities are sums of impulses times entries of at most one, so that impulses of 1e6 N s and more cause rounding errors above
        // the tolerance.
        prop_assert!(left <= 1e-10 + rounding(&iterate), "{left}");
        let mut turned = case.clone();
        turned.contacts.rotate_left(turn % case.contacts.len());
        turned.limits.reverse();
        let (other, mut again) = build::<f64>(&[turned]);
        let (left, _) = newton(&other, &mut again, 300, 1e-10);
        prop_assert!(left <= 1e-10 + rounding(&again), "{left}");
        // The energy norm of the error is at most the root of sum |lambda_i| r.
        let normals = iterate.contacts.iter().step_by(3).chain(again.contacts.iter().step_by(3));
        let impulse: f64 = normals.chain(iterate.scalars.iter().chain(&again.scalars)).sum();
        let tolerance = 2.0 * (impulse * 1e-10).sqrt() + 1e-9;
        prop_assert!(apart(&iterate, &again) <= tolerance, "{} {tolerance}", apart(&iterate, &again));
        let mut swept = iterate.clone();
        swept.contacts.fill(0.0);
        swept.scalars.fill(0.0);
        swept.compute_w(&problem);
        let outcome = gauss_seidel::solve(&problem, &mut swept, gauss_seidel::SweepSettings { sweeps: 20_000, tolerance: 1e-10 }, true);
        prop_assume!(swept_too.count(outcome.residual <= 1e-10));
        let impulse = impulse + swept.contacts.iter().step_by(3).chain(&swept.scalars).sum::<f64>();
        prop_assert!(apart(&iterate, &swept) <= 2.0 * (impulse * 1e-10).sqrt() + 1e-9);
    });
    // A property of the random problems: 0.757 of 26,450 draws.
    answered.at_least(0.74, "with an answer for certain");
    // After 20,000 sweeps, 0.1 % of 20,000 draws remained unsolved. They have rows that are nearly multiples of others.
    swept_too.at_least(0.998, "solved by sweeps too");
}

/// Impulses of least norm are the same from zero impulses and from the result of sweeps, and in any order of the contacts.
#[test]
fn shared_loads_depend_on_neither_start_nor_order() {
    let solved = Share::default();
    proptest!(cases(300), |(case in case(4, 1.0, Just(0.0)), turn in 1usize..8)| {
        let mut doubled = Case { limits: vec![], ..case };
        let copies = doubled.contacts.clone();
        doubled.contacts.extend(copies);
        let (problem, mut cold) = build::<f64>(std::slice::from_ref(&doubled));
        let n = doubled.contacts.len();
        doubled.contacts.rotate_left(turn % n);
        let (turned, mut other) = build::<f64>(&[doubled]);
        let mut swept = cold.clone();
        gauss_seidel::solve(&problem, &mut swept, gauss_seidel::SweepSettings { sweeps: 50, tolerance: 1e-10 }, true);
        let share = |problem: &Problem<f64>, iterate: &mut Iterate<f64>| {
            let (mut left, mut taken) = (residual(problem, iterate), 0.0);
            let search = Search { steps: 300, tolerance: 1e-11, least_norm: true };
            Newton::default().solve(problem, iterate, search, true, [&mut left, &mut taken]);
            left
        };
        let left = [share(&problem, &mut cold), share(&problem, &mut swept), share(&turned, &mut other)];
        prop_assume!(solved.count(left.iter().all(|&left| left <= 1e-11)));
        let size = cold.contacts.iter().step_by(3).fold(1e-3f64, |most, &normal| most.max(normal));
        for k in 0..n {
            // The proximal step is so long that the relative error of the least impulses is 1 / kappa = 1e-5.
            prop_assert!((cold.contacts[3 * k] - swept.contacts[3 * k]).abs() <= 1e-4 * size, "{:?} {:?}", cold.contacts, swept.contacts);
            let same = other.contacts[3 * ((k + n - turn % n) % n)];
            prop_assert!((cold.contacts[3 * k] - same).abs() <= 1e-4 * size, "{:?} {:?}", cold.contacts, other.contacts);
        }
    });
    // Without friction all problems are solved: none of 35,000 draws remained unsolved.
    solved.at_least(0.9999, "solved");
}

/// If every contact of a problem is added twice, the two copies get equal impulses.
#[test]
fn redundant_contacts_share() {
    let solved = Share::default();
    proptest!(cases(300), |(case in case(4, 1.0, 0.0..0.5))| {
        let once = Case { limits: vec![], ..case };
        let twice = Case { contacts: once.contacts.iter().flat_map(|c| [c.clone(), c.clone()]).collect(), ..once.clone() };
        let (problem, mut iterate) = build::<f64>(&[once]);
        let (doubled, mut both) = build::<f64>(&[twice]);
        let left = [newton(&problem, &mut iterate, 300, 1e-11).0, newton(&doubled, &mut both, 300, 1e-11).0];
        prop_assume!(solved.count(left[0] <= 1e-11 && left[1] <= 1e-11));
        let size = 1.0 + bits(&both).iter().fold(0.0f64, |m, &x| m.max(f64::from_bits(x).abs()));
        for pair in both.contacts.as_chunks::<3>().0.chunks(2) {
            for k in 0..3 {
                prop_assert!((pair[0][k] - pair[1][k]).abs() <= 1e-9 * size, "{pair:?}");
            }
        }
    });
    // With friction nothing guarantees a solution. Of 20,007 draws 0.01 % remained unsolved. Their rows couple normal and tangent as no
    // machine does.
    solved.at_least(0.9995, "solved");
}

/// Rounding error of velocities, m/s: a few units in the last place of the sum of all normal impulses and limit impulses.
fn rounding(iterate: &Iterate<f64>) -> f64 {
    4.0 * f64::EPSILON * iterate.contacts.iter().step_by(3).chain(&iterate.scalars).sum::<f64>()
}

/// Whether the problem has a solution for any target velocities.
///
/// The condition is that there are fewer rows than coordinates, and that no row is nearly a combination of others, except for duplicates.
/// The limits of two coordinates, for example, determine the velocity of a contact that moves with both.
fn has_an_answer(case: &Case) -> bool {
    let contacts = case.contacts.iter().map(|c| c.y.iter().map(|y| y[0]).collect::<Vec<f64>>());
    let mut rows: Vec<Vec<f64>> = case.limits.iter().map(|l| l.0.clone()).chain(contacts).collect();
    let fewer = rows.len() < case.n;
    rows.dedup();
    let y = nalgebra::DMatrix::from_fn(rows.len(), case.n, |i, j| rows[i][j] / rows[i].iter().map(|y| y * y).sum::<f64>().sqrt());
    // A motion of 1e5 m/s is known to 1e-11 m/s, less than the tolerance.
    fewer && y.iter().all(|y| y.is_finite()) && y.singular_values().min() > 1e-5
}

/// List of `count` random problems from [`case`], the same at every run. The other arguments are those of `case`.
fn problems(count: usize, most: usize, ratio: f64, mu: impl Strategy<Value = f64> + Clone + 'static) -> Vec<Case> {
    use proptest::strategy::ValueTree;
    let mut runner = proptest::test_runner::TestRunner::deterministic();
    let strategy = case(most, ratio, mu);
    (0..count).map(|_| strategy.new_tree(&mut runner).unwrap().current()).collect()
}

/// Random rows may have infeasible targets, and couple normal and tangent as no machine does. With friction coefficients up to 0.3 a
/// solution nearly always exists; up to 1.5 it often does not. 20,000 sweeps find a few solutions that Newton's method misses, and miss as
/// many that it finds.
#[test]
fn nearly_all_random_problems_are_solved() {
    for (mu, most) in [(0.3, MOST_LEFT[0]), (1.5, MOST_LEFT[1])] {
        let cases: Vec<Case> = problems(500, 9, 1e2, 0.0..mu).into_iter().filter(|c| c.contacts.len() + c.limits.len() < c.n).collect();
        let left = cases.iter().filter(|case| {
            let (problem, mut iterate) = build::<f64>(std::slice::from_ref(case));
            newton(&problem, &mut iterate, 200, 1e-9).0 > 1e-9
        });
        let left = left.count() as f64 / cases.len() as f64;
        println!("friction to {mu}: {left:.3} of {} left", cases.len());
        assert!(left <= most, "{left}");
    }
}

/// Largest fraction of the problems that may remain unsolved, for friction coefficients up to 0.3 and up to 1.5. The test prints the
/// measured fractions.
const MOST_LEFT: [f64; 2] = [0.005, 0.01];

/// Problem with one contact, whose normal and tangential rows are coupled by the number `coupling`. If the size of the coupling exceeds
/// 1/mu, pressing makes the contact slide, and sliding makes it press (Painleve 1895). `slip` is the slip velocity without impulses, m/s.
fn painleve(coupling: f64, slip: f64) -> Case {
    let y = vec![[1.0, coupling, 0.0], [0.0, 0.3, 0.0], [0.0, 0.0, 1.0]];
    Case { n: 3, limits: vec![], contacts: vec![Contact { y, mu: 1.2, g: [-0.1, slip, 0.0] }] }
}

#[test]
fn painleve_problems_stay_finite_and_are_reported() {
    for coupling in [-8.0, -3.0, -1.5, -0.9, 0.9, 1.5, 3.0, 8.0] {
        for slip in [-5.0, -0.1, 0.0, 0.1, 5.0] {
            for sweeps in [1, 10] {
                let (problem, mut iterate) = build::<f64>(&[painleve(coupling, slip)]);
                let settings = Settings::new(sweeps, 50, 1e-9);
                let outcome = solve(&problem, &mut iterate, settings, true, &mut Newton::default());
                assert!(bits(&iterate).iter().all(|&x| f64::from_bits(x).is_finite()), "{coupling} {slip}");
                let size = 1.0 + iterate.contacts.iter().fold(0.0f64, |m, x| m.max(x.abs())) * coupling.abs();
                assert!((outcome.residual - residual(&problem, &iterate)).abs() <= 1e-14 * size, "{coupling} {slip}");
            }
        }
    }
}

#[test]
fn running_out_of_steps_is_reported_and_no_worse_than_sweeps() {
    let mut ran_out = 0;
    for case in problems(100, 9, 1e2, 0.5..1.5) {
        let mut sweeps = f64::INFINITY;
        for newton in [0, 1, 2, 4] {
            let (problem, mut iterate) = build::<f64>(std::slice::from_ref(&case));
            let settings = Settings::new(2, newton, 1e-12);
            let outcome = solve(&problem, &mut iterate, settings, true, &mut Newton::default());
            let most = PASSES * STEPS_RATIO as usize;
            assert!(outcome.newton_steps <= f64::from(newton) * (most * case.contacts.len()) as f64);
            sweeps = sweeps.min(if newton == 0 { outcome.residual } else { f64::INFINITY });
            // Sweeps and Newton's method add the same numbers up in different orders.
            assert!(outcome.residual <= sweeps * (1.0 + 1e-14), "{} {sweeps}", outcome.residual);
            ran_out += u32::from(newton == 1 && outcome.residual > 1e-12);
        }
    }
    assert!(ran_out > 30, "only {ran_out} ran out");
}

#[test]
fn a_solved_lane_keeps_its_bits() {
    let cases = problems(F64Lanes::LANES, 6, 1e1, 0.0..0.5);
    let (problem, mut iterate) = build::<F64Lanes>(&cases);
    let mut newton = Newton::default();
    let settings = Settings::new(200, 100, F64Lanes::of(1e-8));
    let outcome = solve(&problem, &mut iterate, settings, Mask::splat(true), &mut newton);
    let (mut left, mut taken) = (outcome.residual, F64Lanes::zero());
    let before = iterate.clone();
    let search = Search { steps: 10, tolerance: F64Lanes::of(1e-9), least_norm: false };
    newton.solve(&problem, &mut iterate, search, Mask::from_bits(0b10), [&mut left, &mut taken]);
    for l in (0..F64Lanes::LANES).filter(|&l| l != 1) {
        assert!(iterate.w.iter().zip(&before.w).all(|(a, b)| a.lane(l).to_bits() == b.lane(l).to_bits()));
        assert_eq!(taken.lane(l), 0.0);
    }
}

#[test]
fn numbers_that_are_none_are_left_alone() {
    let mut case = painleve(0.2, 1.0);
    case.contacts[0].g[1] = f64::NAN;
    let (problem, mut iterate) = build::<f64>(&[case]);
    let outcome = solve(&problem, &mut iterate, Settings::new(3, 5, 1e-9), true, &mut Newton::default());
    assert!(outcome.residual.is_nan());
    assert_eq!(outcome.newton_steps, 0.0);
}

//! Tests that a lane has the same bits as its problem solved alone.
//!
//! This also holds when other lanes have springs and this lane has none.

use crate::common::cases;
use proptest::prelude::*;
use stepper_real::array::F64x4;
use stepper_real::{Mask, Real};
use stepper_solve::gauss_seidel::{self, SweepSettings};
use stepper_solve::newton::Newton;
use stepper_solve::{Iterate, Problem, Settings};

/// Portable lanes. The tests of the core crate compare the lanes of every CPU level.
type Lanes = F64x4;

const N: usize = 9;
const CONTACTS: usize = 3;
/// Number of random numbers of a problem. The problem has a limit in every coordinate, contacts with sliding friction, and one contact with
/// rolling friction.
///
/// A contact has a compliance if its number for the compliance is above zero.
const NUMBERS: usize = N * (N + 1) + CONTACTS * (3 * N + 4) + 6 * N + 6;
const ROWS: usize = N + CONTACTS + 1;

/// Random numbers of one problem for each lane, and which rows of the problem exist.
type Problems = Vec<(Vec<f64>, Vec<bool>)>;

fn problems() -> impl Strategy<Value = Problems> {
    prop::collection::vec((prop::collection::vec(-1.0..1.0, NUMBERS), prop::collection::vec(any::<bool>(), ROWS)), Lanes::LANES)
}

/// Problem with the numbers of one environment in each lane, and an iterate whose impulses are not all zero.
fn build<R: Real<Scalar = f64>>(problems: &Problems) -> (Problem<R>, Iterate<R>) {
    let mut at = 0;
    let mut next = || {
        let mut x = R::zero();
        problems.iter().enumerate().for_each(|(l, (numbers, _))| x.set_lane(l, numbers[at]));
        at += 1;
        x
    };
    let active = |row: usize| R::Mask::from_bits(problems.iter().enumerate().fold(0, |bits, (l, p)| bits | u32::from(p.1[row]) << l));
    let keep = |row: usize, x: R| R::select(active(row), x, R::zero());
    let mut capacity = stepper_solve::Capacity::of_coordinates(N);
    (capacity.scalars, capacity.scalar_entries, capacity.columns_per_contact) = (N, N * N, N);
    (capacity.contacts, capacity.rolling_contacts) = (CONTACTS, 1);
    let (mut problem, mut iterate) = (Problem::new(&capacity), Iterate::new(&capacity));
    iterate.clear();
    let columns: Vec<u32> = (0..N as u32).collect();
    for row in 0..N {
        let y: Vec<R> = columns.iter().map(|_| next()).collect();
        problem.scalars.push(&columns, |i| y[i], R::one(), active(row), next(), [R::zero(), R::of(f64::INFINITY)]);
        iterate.scalars.push(keep(row, R::of(0.1)));
    }
    for k in 0..CONTACTS {
        let row = N + k;
        let y: Vec<[R; 3]> = columns.iter().map(|_| [keep(row, next()), keep(row, next()), keep(row, next())]).collect();
        let g = [next(), next(), next()];
        problem.push_contact(&columns, |i| y[i], active(row), R::of(0.4), g);
        // As in groups in which some lanes touch soft surfaces, where a rigid contact has a compliance of zero.
        let compliance = keep(row, next().max(R::zero()));
        if compliance.gt(R::zero()).any() {
            problem.contacts.set_compliance(compliance);
        }
        iterate.contacts.extend([keep(row, R::of(0.2)), R::zero(), R::zero()]);
    }
    let row = N + CONTACTS;
    let y: Vec<[R; 6]> = columns.iter().map(|_| std::array::from_fn(|_| keep(row, next()))).collect();
    problem.push_contact(&columns, |i| y[i], active(row), R::of(0.6), std::array::from_fn(|_| next()));
    iterate.contacts.extend([R::zero(); 6]);
    iterate.compute_w(&problem);
    (problem, iterate)
}

/// Bits of the numbers `more`, and of all impulses and the scaled velocity change w of an iterate: one list for each lane.
fn bits<R: Real<Scalar = f64>>(more: &[R], iterate: &Iterate<R>) -> Vec<Vec<u64>> {
    let impulses = [&iterate.contacts[..], &iterate.scalars, &iterate.w].concat();
    let all = [more, &impulses].concat();
    (0..R::LANES).map(|l| all.iter().map(|x| x.lane(l).to_bits()).collect()).collect()
}

/// Bits of each lane after a solve. If `sweeps_alone`, the solve makes sweeps only; otherwise it makes a few sweeps and then Newton steps.
fn left<R: Real<Scalar = f64>>(problems: &Problems, tolerance: f64, sweeps_alone: bool) -> Vec<Vec<u64>> {
    let (problem, mut iterate) = build::<R>(problems);
    let (tolerance, all) = (R::of(tolerance), R::Mask::splat(true));
    let [residual, effort] = if sweeps_alone {
        let outcome = gauss_seidel::solve(&problem, &mut iterate, SweepSettings { sweeps: 60, tolerance }, all);
        [outcome.residual, outcome.sweeps]
    } else {
        let settings = Settings::new(3, 20, tolerance);
        let outcome = stepper_solve::solve(&problem, &mut iterate, settings, all, &mut Newton::default());
        [outcome.residual, outcome.newton_steps]
    };
    bits(&[residual, effort], &iterate)
}

proptest! {
    #![proptest_config(cases(60))]

    #[test]
    fn a_lane_has_the_bits_of_its_problem_alone(
        problems in problems(),
        tolerance in prop_oneof![Just(1e-3), Just(1e-9)],
        sweeps_alone in any::<bool>(),
    ) {
        let together = left::<Lanes>(&problems, tolerance, sweeps_alone);
        for (l, problem) in problems.into_iter().enumerate() {
            let alone = left::<f64>(&vec![problem], tolerance, sweeps_alone);
            prop_assert_eq!(&together[l], &alone[0], "lane {}", l);
        }
    }

    #[test]
    fn an_estimate_from_none_follows_from_the_problem_alone(problems in problems(), lane in 0..Lanes::LANES, sweeps in 1u32..4) {
        let (problem, mut iterate) = build::<Lanes>(&problems);
        let (_, mut other) = build::<Lanes>(&problems);
        let three = Lanes::of(3.0);
        for lambda in other.scalars.iter_mut().chain(&mut other.contacts) {
            *lambda *= three;
        }
        other.contacts[3 * CONTACTS..].fill(three);
        other.compute_w(&problem);
        let before = bits(&[], &other);
        for iterate in [&mut iterate, &mut other] {
            gauss_seidel::sweep_from_zero(&problem, iterate, sweeps, Mask::from_bits(1 << lane));
        }
        let [from_one, from_another] = [&iterate, &other].map(|iterate| bits(&[], iterate));
        prop_assert_eq!(&from_one[lane], &from_another[lane]);
        for other in (0..Lanes::LANES).filter(|&other| other != lane) {
            prop_assert_eq!(&before[other], &from_another[other], "other lanes keep their impulses");
        }
    }
}

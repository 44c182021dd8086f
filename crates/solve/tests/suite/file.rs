//! Tests of saved problems: reading gives the same problem bit for bit or a clear error. Hard problems that simulations have saved are
//! solved.

use crate::common::cases;
use proptest::prelude::*;
use stepper_real::{F64Lanes, Real};
use stepper_solve::newton::Newton;
use stepper_solve::{FORMAT_VERSION, Iterate, LoadedProblem, Problem, Settings, System, residual, solve};

const N: usize = 8;
const SETTINGS: Settings<f64> = Settings::new(5, 40, 1e-9);

/// Random problem with an eliminated equality, a limit with a compliance, and contacts with three, six and three rows, of which one
/// has a compliance.
///
/// The problem uses the `numbers`, which are in -1 to 1, one after the other. The iterate has impulses that are not all zero.
fn build(numbers: &[f64]) -> (Problem<f64>, Iterate<f64>) {
    let mut next = numbers.iter().copied().cycle();
    let mut number = || next.next().unwrap();
    let mut capacity = stepper_solve::Capacity::of_coordinates(N);
    (capacity.scalars, capacity.contacts, capacity.rolling_contacts) = (2, 2, 1);
    let (mut problem, mut iterate) = (Problem::new(&capacity), Iterate::new(&capacity));
    let all: Vec<u32> = (0..N as u32).collect();
    problem.scalars.push(&[0], |_| 1.5, 1.0, true, number(), [f64::NEG_INFINITY, f64::INFINITY]);
    problem.scalars.mark_eliminated();
    let row: Vec<f64> = (0..N).map(|_| number()).collect();
    problem.scalars.push(&all[1..], |c| row[c], 1.0, true, number(), [0.0, f64::INFINITY]);
    problem.scalars.set_compliance(0.3);
    problem.scalars.set_position_offset(number());
    for k in 0..2 {
        let y: Vec<[f64; 3]> = (0..N).map(|_| [number(), number(), number()]).collect();
        problem.push_contact(&all[1..], |c| y[c], true, 0.5, [number(), number(), number()]);
        problem.contacts.set_mobility_ratio(1.25);
        problem.contacts.set_position_offset(&[number(), 0.0, number()]);
        if k == 1 {
            problem.contacts.set_compliance(0.1);
        }
        iterate.contacts.extend([0.1, 0.01, number() * 0.01]);
        if k == 0 {
            let y: Vec<[f64; 6]> = (0..N).map(|_| [(); 6].map(|()| number())).collect();
            problem.push_contact(&all[1..], |c| y[c], true, 0.3, [(); 6].map(|()| number()));
            iterate.contacts.extend([0.1, 0.0, 0.0, 0.01, 0.0, 0.0]);
        }
    }
    iterate.scalars.extend([number(), 0.2]);
    iterate.compute_w(&problem);
    (problem, iterate)
}

fn solved(problem: &Problem<f64>, iterate: &mut Iterate<f64>, settings: Settings<f64>) -> Vec<u64> {
    let outcome = solve(problem, iterate, settings, true, &mut Newton::default());
    let impulses = iterate.scalars.iter().chain(&iterate.contacts);
    [outcome.residual].iter().chain(impulses).chain(&iterate.w).map(|x| x.to_bits()).collect()
}

fn bytes() -> Vec<u8> {
    let (problem, iterate) = build(&[0.3, -0.7, 0.5, 0.9, -0.1, 0.4, -0.6]);
    System::from(&problem).to_bytes(&iterate, &SETTINGS, 0)
}

proptest! {
    #![proptest_config(cases(64))]

    #[test]
    fn a_problem_that_is_loaded_is_solved_with_the_same_bits(numbers in prop::collection::vec(-1.0..1.0f64, 67)) {
        let (problem, mut iterate) = build(&numbers);
        let bytes = System::from(&problem).to_bytes(&iterate, &SETTINGS, 0);
        let LoadedProblem { problem: again, iterate: mut start, settings } = Problem::<f64>::from_bytes(&bytes).unwrap();
        prop_assert_eq!(System::from(&again).to_bytes(&start, &settings, 0), bytes);
        prop_assert_eq!(solved(&again, &mut start, settings), solved(&problem, &mut iterate, SETTINGS));
    }

    #[test]
    fn every_bit_flip_is_refused(at in 0..bytes().len(), bit in 0..8_u8) {
        let mut bytes = bytes();
        bytes[at] ^= 1 << bit;
        prop_assert!(Problem::<f64>::from_bytes(&bytes).is_err());
    }
}

#[test]
fn refusals_say_what_and_what_to_do() {
    let text = |bytes: &[u8]| Problem::<f64>::from_bytes(bytes).unwrap_err().to_string();
    let good = bytes();
    assert!(text(b"<mujoco/>").contains("saved problem: not a saved problem") && text(b"<mujoco/>").contains("sim.save_problem"));
    assert!(text(&good[..20]).contains("cut off after 20 bytes"));
    let mut other = good.clone();
    other[8] = 77;
    assert!(text(&other).contains(&format!("format version 77, this stepper reads {FORMAT_VERSION}")));
    *other.last_mut().unwrap() ^= 1;
    other[8] = good[8];
    assert!(text(&other).contains("damaged"));
    let missing = Problem::<f64>::load("/no/such/folder/a.problem").unwrap_err().to_string();
    assert!(missing.contains("/no/such/folder/a.problem") && missing.contains("check the path"), "{missing}");
}

#[test]
fn every_lane_has_the_problem_that_was_saved() {
    let LoadedProblem { problem, iterate, settings } = Problem::<F64Lanes>::from_bytes(&bytes()).unwrap();
    for lane in [0, 2] {
        assert_eq!(System::from(&problem).to_bytes(&iterate, &settings, lane), bytes());
    }
    let left = residual(&problem, &iterate);
    assert_eq!(left.lane(0).to_bits(), left.lane(F64Lanes::LANES - 1).to_bits());
}

/// Problems that `Stepper.save_problem` has written where sweeps alone leave a residual: each is solved by sweeps and Newton's method
/// together.
#[test]
fn hard_problems_of_simulations_are_solved() {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/problems");
    let mut files: Vec<_> = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.sort();
    assert!(!files.is_empty(), "no problems in {folder}");
    for file in files {
        let LoadedProblem { problem, iterate: start, settings } = Problem::<f64>::load(&file).unwrap();
        let settings = Settings { sweeps: 50, newton_steps: 50, ..settings };
        let mut iterate = start.clone();
        let swept = solve(&problem, &mut iterate, Settings { sweeps: 3, newton_steps: 0, ..settings }, true, &mut Newton::default());
        assert!(swept.residual > settings.tolerance, "{}: sweeps leave {:e}", file.display(), swept.residual);
        let mut iterate = start;
        let outcome = solve(&problem, &mut iterate, settings, true, &mut Newton::default());
        assert!(outcome.residual <= settings.tolerance, "{}: {:e} is left", file.display(), outcome.residual);
        assert!(residual(&problem, &iterate) <= settings.tolerance);
    }
}

//! Tests of Newton's method on single-lane problems with equalities, with compliance, and with cones of any number of tangents; and of its
//! matrix.

use crate::admissible_set::AdmissibleSet;
use crate::constraints::constraint_set::LaneConstraint;
use crate::newton::lane::Lane;
use crate::newton::skyline::Skyline;
use crate::newton::{Newton, Search};
use crate::vectors::{TILE, Tile};

const SEARCH: Search<f64> = Search { steps: 100, tolerance: 1e-11, least_norm: false };
const FREE: AdmissibleSet = AdmissibleSet::Interval { lo: f64::NEG_INFINITY, hi: f64::INFINITY };

/// Pseudorandom number in [-1, 1] that depends on the seed alone.
fn noise(seed: usize) -> f64 {
    let x = (seed as f64 * 12.9898).sin() * 43758.5453;
    2.0 * (x - x.floor()) - 1.0
}

fn lane(dimension: usize) -> Newton {
    let mut newton = Newton::default();
    newton.lane.w.resize(dimension, 0.0);
    newton
}

fn row<const N: usize>(lane: &mut Lane, seed: usize, set: AdmissibleSet, g: [f64; N], compliance: f64) {
    let n = lane.w.len();
    let columns: Vec<u32> = (0..n as u32).collect();
    let entries = (0..n).flat_map(|c| -> [f64; N] { std::array::from_fn(|r| noise(1000 * seed + 10 * c + r)) });
    let constraint = LaneConstraint { set, compliance, normal_compliance: 0.0, mobility_ratio: 1.0 };
    lane.add(constraint, [0; 2], [&g, &[0.0; N]], &columns, entries);
}

/// Velocity y . w + R lambda + g of every row of a lane, m/s.
fn velocities(lane: &Lane) -> Vec<f64> {
    let mut v = vec![];
    for block in &lane.blocks {
        let (columns, y) = lane.entries(block);
        for (r, row) in block.rows.clone().enumerate() {
            let sum: f64 = columns.iter().enumerate().map(|(k, &c)| y[k * block.rows.len() + r] * lane.w[c as usize]).sum();
            v.push(sum + block.constraint.compliance * lane.lambda[row] + lane.g[row]);
        }
    }
    v
}

#[test]
fn equalities_hold_and_compliance_gives() {
    let mut newton = lane(7);
    for (i, compliance) in [0.0, 0.3, 2.0].into_iter().enumerate() {
        row(&mut newton.lane, i, FREE, [noise(77 + i)], compliance);
    }
    let result = newton.solve_lane::<f64>(SEARCH);
    assert!(result.residual <= 1e-11, "{}", result.residual);
    // A linear problem: proximal steps of one Newton step each, with kappa 3e1, 3e2, 3e3, 3e4, and one to polish.
    assert!(result.steps <= 5, "{}", result.steps);
    assert!(velocities(&newton.lane).iter().all(|v| v.abs() <= 1e-10));
    assert!(newton.lane.lambda.iter().all(|l| l.abs() > 1e-3));
}

#[test]
fn equalities_that_say_the_same_share_evenly() {
    let mut newton = lane(7);
    for _ in 0..3 {
        row(&mut newton.lane, 4, FREE, [0.7], 0.0);
    }
    let result = newton.solve_lane::<f64>(SEARCH);
    assert!(result.residual <= 1e-11);
    let lambda = &newton.lane.lambda;
    assert!((lambda[0] - lambda[1]).abs() + (lambda[0] - lambda[2]).abs() <= 1e-12);
}

#[test]
fn bounds_saturate() {
    let mut newton = lane(5);
    row(&mut newton.lane, 1, AdmissibleSet::Interval { lo: -0.1, hi: 0.1 }, [3.0], 0.0);
    let result = newton.solve_lane::<f64>(SEARCH);
    assert!(result.residual <= 1e-11);
    assert_eq!(newton.lane.lambda, [-0.1]);
}

/// Solves one contact with `T` rows, and tests the friction law: no normal velocity, an impulse inside the cone, and friction opposite to
/// the slip.
fn cone<const T: usize>(mu: f64, pull: f64) {
    let mut newton = lane(9);
    let g: [f64; T] = std::array::from_fn(|k| if k == 0 { -1.0 } else { pull * noise(5 + k) });
    row(&mut newton.lane, 2, AdmissibleSet::Cone { mu }, g, 0.0);
    let result = newton.solve_lane::<f64>(SEARCH);
    assert!(result.residual <= 1e-11, "{T} rows: {}", result.residual);
    let (v, lambda) = (velocities(&newton.lane), &newton.lane.lambda);
    let length = |x: &[f64]| x.iter().map(|x| x * x).sum::<f64>().sqrt();
    let dissipated: f64 = v[1..].iter().zip(&lambda[1..]).map(|(v, l)| v * l).sum();
    assert!(lambda[0] > 0.0 && v[0].abs() < 1e-10);
    assert!(length(&lambda[1..]) <= mu * lambda[0] * (1.0 + 1e-12));
    assert!((dissipated + mu * lambda[0] * length(&v[1..])).abs() < 1e-9);
    let sticks = length(&v[1..]) < 1e-9;
    assert_eq!(sticks, mu > 1.0, "{T} rows");
}

#[test]
fn cones_have_any_number_of_tangents() {
    for (mu, pull) in [(2.0, 0.01), (0.2, 3.0)] {
        cone::<2>(mu, pull);
        cone::<3>(mu, pull);
        cone::<4>(mu, pull);
        cone::<6>(mu, pull);
    }
}

#[test]
fn islands_are_solved_apart() {
    let mut newton = lane(8);
    for (i, start) in [0, 4, 0, 4].into_iter().enumerate() {
        let entries = (0..3).map(|c| noise(100 * i + c));
        let columns = [start, start + 1, start + 3];
        let constraint = LaneConstraint { set: FREE, compliance: 0.0, normal_compliance: 0.0, mobility_ratio: 1.0 };
        newton.lane.add(constraint, [0; 2], [&[1.0], &[0.0]], &columns, entries);
    }
    let result = newton.solve_lane::<f64>(SEARCH);
    assert_eq!(newton.islands.count, 2);
    assert_eq!(newton.islands.of_block, [0, 1, 0, 1]);
    assert!(result.residual <= 1e-11);
    assert_eq!((newton.lane.w[2], newton.lane.w[6]), (0.0, 0.0));
}

/// Numbers of `N` rows in each of `tiles` tiles.
fn random_rows<const N: usize>(seed: usize, tiles: usize) -> Vec<[Tile; N]> {
    (0..tiles).map(|t| std::array::from_fn(|r| std::array::from_fn(|c| noise(seed + (N * t + r) * TILE + c)))).collect()
}

/// Adds `f` to the entries of a matrix between all coordinates of the tiles `tiles`. The arguments of `f` are the row and the column, each
/// as the index of the tile in `tiles` and the place in the tile.
fn add_products(dense: &mut [Vec<f64>], tiles: &[usize], f: impl Fn([usize; 2], [usize; 2]) -> f64) {
    let places = || (0..tiles.len() * TILE).map(|i| [i / TILE, i % TILE]);
    for (row, column) in places().flat_map(|row| places().map(move |column| (row, column))) {
        let [i, j] = [row, column].map(|[tile, place]| TILE * tiles[tile] + place);
        dense[i][j] += f(row, column);
    }
}

/// Adds a symmetric sum over `N` rows to both matrices, and an outer product of two rows unless `symmetric`.
fn add_blocks<const N: usize>(matrix: &mut Skyline, dense: &mut [Vec<f64>], [seed, other]: [usize; 2], tiles: &[usize], symmetric: bool) {
    let a = random_rows::<N>(seed, tiles.len());
    let b: Vec<Tile> = random_rows::<1>(other, tiles.len()).iter().map(|[row]| row.map(|x| 0.1 * x)).collect();
    add_products(dense, tiles, |[i, p], [j, q]| (0..N).map(|r| a[i][r][p] * a[j][r][q]).sum());
    if symmetric {
        matrix.add_symmetric(tiles, &a, &a);
    } else {
        let first: Vec<Tile> = a.iter().map(|rows| rows[0]).collect();
        matrix.add_unsymmetric(tiles, [&b, &first], &a);
        add_products(dense, tiles, |[i, p], [j, q]| b[i][p] * a[j][0][q]);
    }
}

/// The factors of a chain of coupled tiles solve a linear system, for a symmetric and an unsymmetric matrix. The identity plus a half of
/// the kept sum is part of it.
#[test]
fn factors_solve() {
    let n = 20;
    for symmetric in [true, false] {
        let mut matrix = Skyline::default();
        let mut dense = vec![vec![0.0; n]; n];
        (0..n).for_each(|i| dense[i][i] = 1.0);
        // The tiles 1 and 4 of one block lie apart.
        let blocks: [&[usize]; 6] = [&[0, 1], &[1, 2], &[2, 3, 4], &[4], &[0], &[1, 4]];
        matrix.reset(n / TILE);
        blocks.iter().for_each(|tiles| matrix.reserve(tiles));
        matrix.complete_pattern();
        for (k, tiles) in blocks.iter().enumerate() {
            let a = random_rows::<1>(700 * k, tiles.len());
            let minus: Vec<[Tile; 1]> = a.iter().map(|[a]| [a.map(|a| -a)]).collect();
            // The first block is taken away again.
            matrix.add_to_kept(tiles, &a, &a);
            if k == 0 {
                matrix.add_to_kept(tiles, &minus, &a);
            } else {
                add_products(&mut dense, tiles, |[i, p], [j, q]| 0.5 * a[i][0][p] * a[j][0][q]);
            }
        }
        matrix.set_to_kept(0.5);
        for (k, tiles) in blocks.iter().enumerate() {
            add_blocks::<1>(&mut matrix, &mut dense, [500 * k, 1], tiles, symmetric);
            add_blocks::<3>(&mut matrix, &mut dense, [500 * k, 1], tiles, symmetric);
            add_blocks::<5>(&mut matrix, &mut dense, [500 * k, 1], tiles, symmetric);
        }
        matrix.complete();
        assert!(matrix.factor(0.0));
        let answer: Vec<f64> = (0..n).map(|i| noise(9000 + i)).collect();
        let mut x: Vec<f64> = dense.iter().map(|row| row.iter().zip(&answer).map(|(a, x)| a * x).sum()).collect();
        matrix.solve(&mut x);
        // The matrices have condition numbers of some hundreds.
        for (x, answer) in x.iter().zip(&answer) {
            assert!((x - answer).abs() < 1e-12, "{symmetric}: {x} {answer}");
        }
    }
}

/// A matrix with a pivot below zero is factorised; one with a tiny pivot is refused.
#[test]
fn indefinite_matrices_have_factors_unless_a_pivot_is_tiny() {
    for (diagonal, factored) in [(-4.0, true), (-1.0, false)] {
        let mut matrix = Skyline::default();
        matrix.reset(1);
        matrix.reserve(&[0]);
        matrix.complete_pattern();
        matrix.set_to_kept(1.0);
        matrix.add_unsymmetric::<0>(&[0], [&[[1.0, 0.0, 0.0, 0.0]], &[[diagonal, 2.0, 0.0, 0.0]]], &[]);
        matrix.complete();
        assert_eq!(matrix.factor(1e-3), factored);
        if factored {
            // [-3 2; 0 1] (1, 1) = (-1, 1)
            let mut x = [-1.0, 1.0, 5.0, 7.0];
            matrix.solve(&mut x);
            assert_eq!(x, [1.0, 1.0, 5.0, 7.0]);
        }
    }
}

/// The factors of a slipping contact (`SlipDerivative::factors`) multiply to `rho Y^T DP Y`, for the step rho, the rows Y and the
/// derivative DP of the map. This includes a contact without friction, and a direction of slip whose last component is zero. Central
/// differences of the map confirm DP.
fn factors_multiply_to_the_derivative<const N: usize>() {
    for seed in 0..40 {
        let (mu, rho) = (if seed % 4 == 0 { 0.0 } else { 0.7 }, 3.0);
        let number = |k| noise(100 * seed + k);
        let mut x: [f64; N] = std::array::from_fn(|k| if k == 0 { 0.3 } else { 2.0 * number(k).signum() + number(k) });
        if N > 2 && seed % 3 == 0 {
            x[N - 1] = 0.0_f64.copysign(number(0));
        }
        let set = AdmissibleSet::Cone { mu };
        let mode = set.map(x).1;
        let y: [Tile; N] = std::array::from_fn(|r| std::array::from_fn(|c| noise(1000 + 100 * seed + 10 * r + c)));
        let (a, q) = set.slip(mode, x).expect("the contact slips").factors(rho, &y);
        assert!(q[N - 2..].iter().flatten().all(|&q| q == 0.0));
        let derivative = set.derivative(mode, x);
        for k in 0..N {
            let moved = [1e-6, -1e-6].map(|step| set.map(std::array::from_fn::<f64, N, _>(|i| x[i] + if i == k { step } else { 0.0 })).0);
            for i in 0..N {
                // Values of order 1 give these central differences rounding errors of 1e-10, third derivatives errors of 1e-12.
                let slope = (moved[0][i] - moved[1][i]) / 2e-6;
                assert!((slope - derivative[i][k]).abs() < 1e-8, "{N} rows: {slope} {}", derivative[i][k]);
            }
        }
        for (i, j) in (0..TILE).flat_map(|i| (0..TILE).map(move |j| (i, j))) {
            let expected: f64 =
                (0..N).flat_map(|r| (0..N).map(move |k| (r, k))).map(|(r, k)| y[r][i] * rho * derivative[r][k] * y[k][j]).sum();
            let product = a[i] * y[0][j] + q.iter().map(|q| q[i] * q[j]).sum::<f64>();
            // Sums of some tens of numbers of order 1.
            assert!((product - expected).abs() < 1e-12, "{N} rows: {product} {expected}");
        }
    }
}

#[test]
fn factors_of_slipping_contacts_give_their_derivative() {
    factors_multiply_to_the_derivative::<2>();
    factors_multiply_to_the_derivative::<3>();
    factors_multiply_to_the_derivative::<4>();
    factors_multiply_to_the_derivative::<5>();
    factors_multiply_to_the_derivative::<6>();
}

//! Constraint problems of boxes that lie, stand and press on each other: six coordinates per box, four contacts where two faces touch.
//!
//! Each problem is the contact problem of one time step of [`STEP`] seconds. The boxes start at rest under gravity, without warm start.

use stepper_real::Real;
use stepper_solve::{Capacity, Iterate, Problem};

/// Time step, s.
pub const STEP: f64 = 0.002;
/// Friction coefficient.
pub const FRICTION: f64 = 0.5;
const GRAVITY: f64 = 9.81;

/// Box with axes parallel to those of the world.
#[derive(Clone, Copy, Debug)]
pub struct Brick {
    /// Mass, kg.
    pub mass: f64,
    /// Centre, m.
    pub centre: [f64; 3],
    /// Half sizes, m.
    pub half: [f64; 3],
    /// Force on the centre in addition to gravity, N.
    pub push: [f64; 3],
}

/// Scene of boxes (bricks) and the contacts between their faces.
#[derive(Clone, Debug)]
pub struct Heap {
    /// Name of the scene, printed in the first column of the table of solver iterations and times.
    pub name: String,
    bricks: Vec<Brick>,
    /// Contact points at corners: index of the first brick (`None` is the floor), index of the second brick, point, and axis of the normal.
    /// The normal points from the first brick to the second.
    contacts: Vec<(Option<usize>, usize, [f64; 3], usize)>,
}

impl Heap {
    /// All scenes in the table of solver iterations and times.
    pub fn all() -> Vec<Self> {
        let mut all: Vec<Self> = [1.0, 100.0, 1000.0].into_iter().map(Self::stack).collect();
        all.extend([Self::wall(6, 5), Self::wall(20, 10), Self::pinch(0.05), Self::pinch(0.001), Self::crush()]);
        all
    }

    /// Stack of ten cubes of 1 kg, except that the top one has a mass of `top` kg.
    pub fn stack(top: f64) -> Self {
        let mut heap = Self::named(if top > 1.0 { format!("10 boxes, top {top} times heavier") } else { "10 boxes, equal masses".into() });
        for i in 0..10 {
            let mass = if i == 9 { top } else { 1.0 };
            heap.add(mass, [0.0, 0.0, 0.1 + 0.2 * f64::from(i)], [0.1; 3]);
        }
        heap.meet()
    }

    /// Wall of `courses` courses with `bricks` bricks each. Every second course is shifted by half a brick.
    pub fn wall(courses: usize, bricks: usize) -> Self {
        let mut heap = Self::named(format!("wall of {bricks}x{courses} boxes"));
        for course in 0..courses {
            let shift = if course % 2 == 1 { 0.1 } else { 0.0 };
            for i in 0..bricks {
                heap.add(1.0, [0.2 * i as f64 + shift, 0.0, 0.05 + 0.1 * course as f64], [0.1, 0.05, 0.05]);
            }
        }
        heap.meet()
    }

    /// Cube of `mass` kg between two cubes of 1 kg that are pressed against it with 20 N each. Only friction holds the middle cube.
    pub fn pinch(mass: f64) -> Self {
        let mut heap = Self::named(format!("pinch, {} g between 1 kg", 1000.0 * mass));
        for (i, mass) in [1.0, mass, 1.0].into_iter().enumerate() {
            heap.add(mass, [0.1 * i as f64, 0.0, 1.0], [0.05; 3]);
        }
        heap.bricks[0].push = [20.0, 0.0, GRAVITY];
        heap.bricks[2].push = [-20.0, 0.0, GRAVITY];
        heap.meet()
    }

    /// Cube of 1 t on a cube of 1 g.
    pub fn crush() -> Self {
        let mut heap = Self::named("1 g under 1 t cubes".into());
        heap.add(0.001, [0.0, 0.0, 0.1], [0.1; 3]);
        heap.add(1000.0, [0.0, 0.0, 0.3], [0.1; 3]);
        heap.meet()
    }

    fn named(name: String) -> Self {
        Self { name, bricks: vec![], contacts: vec![] }
    }

    fn add(&mut self, mass: f64, centre: [f64; 3], half: [f64; 3]) {
        self.bricks.push(Brick { mass, centre, half, push: [0.0; 3] });
    }

    /// Adds the contacts of the scene. Wherever two faces normal to x or z touch, each corner of their common rectangle is a contact.
    fn meet(mut self) -> Self {
        for above in 0..self.bricks.len() {
            let b = self.bricks[above];
            if b.centre[2] - b.half[2] < 1e-9 {
                self.corners(None, above, 2);
            }
            for below in 0..self.bricks.len() {
                let a = self.bricks[below];
                for axis in [0, 2] {
                    let touch = (b.centre[axis] - b.half[axis] - a.centre[axis] - a.half[axis]).abs() < 1e-9;
                    let share = (0..3).filter(|&k| k != axis).all(|k| (b.centre[k] - a.centre[k]).abs() < a.half[k] + b.half[k] - 1e-9);
                    if touch && share && below != above {
                        self.corners(Some(below), above, axis);
                    }
                }
            }
        }
        self
    }

    /// Adds a contact at each corner of the rectangle that two touching faces share. The faces are normal to `axis`.
    ///
    /// `above` and `below` are the indices of the bricks on the positive and the negative side of the faces; `None` is the floor.
    fn corners(&mut self, below: Option<usize>, above: usize, axis: usize) {
        let b = self.bricks[above];
        let range = |k: usize| {
            let (mut low, mut high) = (b.centre[k] - b.half[k], b.centre[k] + b.half[k]);
            if let Some(a) = below.map(|i| self.bricks[i]) {
                (low, high) = (low.max(a.centre[k] - a.half[k]), high.min(a.centre[k] + a.half[k]));
            }
            [low, high]
        };
        let (i, j) = ((axis + 1) % 3, (axis + 2) % 3);
        for p in range(i) {
            for q in range(j) {
                let mut point = b.centre;
                (point[axis], point[i], point[j]) = (b.centre[axis] - b.half[axis], p, q);
                self.contacts.push((below, above, point, axis));
            }
        }
    }

    /// Number of contacts.
    pub fn len(&self) -> usize {
        self.contacts.len()
    }

    /// Whether there is no contact.
    pub fn is_empty(&self) -> bool {
        self.contacts.is_empty()
    }

    /// Constraint problem of the scene, and the initial iterate of its solver.
    ///
    /// The variable w of the problem is the velocity change of each box, times the square root of the mass or moment of inertia.
    pub fn problem(&self) -> (Problem<f64>, Iterate<f64>) {
        let n = 6 * self.bricks.len();
        let capacity = Capacity { contacts: self.contacts.len(), columns_per_contact: n, ..Capacity::of_coordinates(n) };
        let (mut problem, mut iterate) = (Problem::new(&capacity), Iterate::new(&capacity));
        for &(below, above, point, axis) in &self.contacts {
            let axes = [axis, (axis + 1) % 3, (axis + 2) % 3];
            let mut ends: Vec<(usize, f64)> = below.map(|i| (i, -1.0)).into_iter().chain([(above, 1.0)]).collect();
            ends.sort_by_key(|&(i, _)| i);
            let mut support = vec![];
            let mut entries = vec![[0.0; 3]; n];
            let mut g = [0.0; 3];
            for (i, sign) in ends {
                let b = self.bricks[i];
                let (inertia, arm) = (b.moments(), std::array::from_fn::<f64, 3, _>(|k| point[k] - b.centre[k]));
                for (r, &k) in axes.iter().enumerate() {
                    let gravity = if k == 2 { -GRAVITY } else { 0.0 };
                    g[r] += sign * STEP * (gravity + b.push[k] / b.mass);
                    entries[6 * i + k][r] = sign / b.mass.sqrt();
                    // Velocity of the point along axis k: v_k + (omega x arm)_k.
                    let (p, q) = ((k + 1) % 3, (k + 2) % 3);
                    entries[6 * i + 3 + p][r] = sign * arm[q] / inertia[p].sqrt();
                    entries[6 * i + 3 + q][r] = -sign * arm[p] / inertia[q].sqrt();
                }
                support.extend(6 * i as u32..6 * i as u32 + 6);
            }
            problem.push_contact(&support, |c| entries[c], true, FRICTION, g);
            iterate.contacts.extend([f64::zero(); 3]);
        }
        iterate.compute_w(&problem);
        (problem, iterate)
    }
}

impl Brick {
    /// Moments of inertia about the box's axes, kg m^2.
    fn moments(&self) -> [f64; 3] {
        let [x, y, z] = self.half.map(|h| h * h);
        [y + z, z + x, x + y].map(|s| self.mass / 3.0 * s)
    }
}

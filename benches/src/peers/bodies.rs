//! Scenes of free bodies on a floor for the comparison with rapier. The models of both engines are made from this description.

use std::sync::{Arc, LazyLock};

use stepper_core::analysis::overlaps::overlaps;
use stepper_core::model::{BodyBuilder, GeomBuilder, JointBuilder, Model, WORLD};
use stepper_core::{Options, Precision, Simulation, StepInputs};

use super::GRAVITY;
use crate::scenes::noise;

/// Half size of the sliding box, m.
pub(super) const BOX_HALF: [f64; 3] = [0.2, 0.15, 0.1];
/// Initial speed of the sliding box, m/s.
pub(super) const BOX_SPEED: f64 = 2.0;
/// Friction coefficient between the sliding box and the floor.
pub(super) const BOX_FRICTION: f64 = 0.5;

/// Density of boxes and bricks, kg/m^3. It is that of wood.
const WOOD: f64 = 500.0;
/// Friction coefficient of the bodies in the scenes heap and wall.
const ROUGH: f64 = 0.6;
/// Half width of the bin in the scene heap, m.
const BIN: f64 = 0.22;
/// Number of steps of 2 ms after which the heap is at rest.
const FALL: usize = 600;
/// Half sizes of a brick, m.
const BRICK: [f64; 3] = [0.1, 0.05, 0.03];
/// Gap between neighbouring bricks of a course, m.
const COURSE_GAP: f64 = 0.004;
/// Mass of the plate in SimBenchmark's scene of balls on a plate, kg.
const PLATE: f64 = 10.0;
/// Mass of each ball on the plate, kg.
const BALL: f64 = 1.0;
/// Number of balls along each side of the plate.
const SIDE: usize = 5;
/// Force on the plate, N.
const FORCE: f64 = 150.0;
/// Friction coefficient between the plate and the ground. Contacts of the balls have a coefficient of 0.8.
const SLIPPERY: f64 = 0.4;
/// Unit direction of the force on the plate, 60 degrees from x.
const DIRECTION: [f64; 3] = [0.5, 0.866_025_403_784_438_6, 0.0];

/// Pose of a body: position of its centre, m, and orientation as a quaternion (w, x, y, z).
pub type Pose = ([f64; 3], [f64; 4]);

/// Shape of a free body.
#[derive(Clone, Copy, Debug)]
pub enum Shape {
    /// Sphere with this radius, m.
    Ball(f64),
    /// Box with these half sizes, m.
    Box([f64; 3]),
}

/// Free body of a scene.
#[derive(Clone, Copy, Debug)]
pub struct Solid {
    /// Shape of the body.
    pub shape: Shape,
    /// Mass of the body, kg.
    pub mass: f64,
    /// Friction coefficient of the body. A contact has the larger coefficient of its two bodies.
    pub friction: f64,
    /// Initial pose of the body.
    pub pose: Pose,
    /// Initial velocity of the body's centre, m/s.
    pub velocity: [f64; 3],
}

impl Solid {
    fn upright(shape: Shape, mass: f64, friction: f64, pos: [f64; 3]) -> Self {
        Self { shape, mass, friction, pose: (pos, [1.0, 0.0, 0.0, 0.0]), velocity: [0.0; 3] }
    }

    fn wooden(half: [f64; 3], pos: [f64; 3]) -> Self {
        Self::upright(Shape::Box(half), WOOD * 8.0 * half.iter().product::<f64>(), ROUGH, pos)
    }
}

/// Scene of free bodies on a floor.
#[derive(Clone, Debug)]
pub struct Bodies {
    /// Friction coefficient of the floor and the walls.
    pub friction: f64,
    /// Fixed boxes of the scene: half sizes and centres, m.
    pub walls: Vec<([f64; 3], [f64; 3])>,
    /// Free bodies of the scene.
    pub solids: Vec<Solid>,
    /// Force on the centre of the first free body, N.
    pub push: [f64; 3],
}

impl Bodies {
    fn new(friction: f64, solids: Vec<Solid>) -> Self {
        Self { friction, walls: vec![], solids, push: [0.0; 3] }
    }

    /// Scene box: a box that slides along the floor with an initial speed.
    pub fn sliding_box() -> Self {
        let upright = Solid::upright(Shape::Box(BOX_HALF), 1.0, BOX_FRICTION, [0.0, 0.0, BOX_HALF[2]]);
        Self::new(BOX_FRICTION, vec![Solid { velocity: [BOX_SPEED, 0.0, 0.0], ..upright }])
    }

    /// Scene heap: ten boxes of 4 to 10 cm at rest in a bin. stepper simulates their fall once to find the poses.
    pub fn heap() -> Self {
        static HEAP: LazyLock<Bodies> = LazyLock::new(|| {
            let poured = Bodies::poured();
            let options = Options { timestep: Some(0.002), ..Options::default() };
            let mut simulation = Simulation::new(Arc::new(poured.model()), options, None, Precision::F64, 1).expect("options of a step");
            simulation.step(&StepInputs::default(), FALL).expect("no inputs");
            poured.at(&poses(&simulation))
        });
        HEAP.clone()
    }

    /// Ten boxes with random orientations in layers of four above the bin, before they fall.
    fn poured() -> Self {
        let random = |k: usize, n: usize| noise((100 * k + n) as u64);
        let solid = |k: usize| {
            let half = std::array::from_fn(|i| 0.035 + 0.015 * random(k, i));
            let place = [0, 1].map(|i| if k >> i & 1 == 1 { 0.1 } else { -0.1 } + 0.01 * random(k, 3 + i));
            let turn: [f64; 4] = std::array::from_fn(|i| random(k, 5 + i));
            let norm = turn.iter().map(|x| x * x).sum::<f64>().sqrt();
            let mut solid = Solid::wooden(half, [place[0], place[1], 0.12 + 0.18 * (k / 4) as f64]);
            solid.pose.1 = turn.map(|x| x / norm);
            solid
        };
        let mut bin = Self::new(ROUGH, (0..10).map(solid).collect());
        for side in [-BIN, BIN] {
            bin.walls.push(([0.01, BIN, 0.1], [side, 0.0, 0.1]));
            bin.walls.push(([BIN, 0.01, 0.1], [0.0, side, 0.1]));
        }
        bin
    }

    /// Scene wall: five courses of three bricks. Every second course is shifted by two fifths of a brick.
    ///
    /// With a shift of half a brick, the last brick of the top course would tip: its centre would be beyond the supporting brick.
    pub fn wall() -> Self {
        let brick = |k: usize| {
            let (course, place) = (k / 3, (k % 3) as f64);
            let x = (2.0 * BRICK[0] + COURSE_GAP) * (place - 1.0 + if course % 2 == 1 { 0.2 } else { -0.2 });
            Solid::wooden(BRICK, [x, 0.0, BRICK[2] * (2 * course + 1) as f64])
        };
        Self::new(ROUGH, (0..15).map(brick).collect())
    }

    /// Scene balls: SimBenchmark's plate, which a force pulls along the ground, with 25 balls on it.
    pub fn balls() -> Self {
        let plate = Solid::upright(Shape::Box([10.0, 10.0, 0.5]), PLATE, SLIPPERY, [0.0, 0.0, 0.5]);
        let place = |k: usize| 2.0 * k as f64 - 4.0;
        let ball = |k: usize| Solid::upright(Shape::Ball(0.5), BALL, 0.8, [place(k / SIDE), place(k % SIDE), 1.5]);
        let solids = std::iter::once(plate).chain((0..SIDE * SIDE).map(ball)).collect();
        Self { push: DIRECTION.map(|x| FORCE * x), ..Self::new(SLIPPERY, solids) }
    }

    /// Exact accelerations in the scene balls, m/s^2: plate first, then each ball.
    ///
    /// The friction f between the plate and each of n balls of mass m accelerates the ball's lowest point by f / m (1 + 5/2). The plate of
    /// mass M, pulled with the force F, accelerates by (F - mu (M + n m) g - n f) / M. Rolling without slip makes these two accelerations
    /// equal.
    pub fn rolling_accelerations() -> Vec<[f64; 3]> {
        let n = (SIDE * SIDE) as f64;
        let driving = FORCE - SLIPPERY * (PLATE + n * BALL) * GRAVITY;
        let f = driving / PLATE / (3.5 / BALL + n / PLATE);
        let along = |a: f64| DIRECTION.map(|x| a * x);
        std::iter::once(along((driving - n * f) / PLATE)).chain(std::iter::repeat_n(along(f / BALL), SIDE * SIDE)).collect()
    }

    /// Copy of the scene with the free bodies at rest in the given poses.
    pub fn at(&self, poses: &[Pose]) -> Self {
        let solids = self.solids.iter().zip(poses).map(|(&solid, &pose)| Solid { pose, velocity: [0.0; 3], ..solid });
        Self { solids: solids.collect(), ..self.clone() }
    }

    /// Depth of the deepest overlap in the initial poses, m; 0 if no overlap is deeper than 0.01 mm.
    pub fn deepest_overlap(&self) -> f64 {
        overlaps(&self.model()).first().map_or(0.0, |overlap| overlap.depth)
    }

    /// Model of the scene for stepper.
    pub fn model(&self) -> Model {
        let mut scene = Model::builder("bodies");
        let rough = |geom: GeomBuilder, friction: f64| geom.friction([friction, 0.0, 0.0]);
        scene.geom(WORLD, rough(GeomBuilder::plane("floor"), self.friction));
        for (k, &(half, pos)) in self.walls.iter().enumerate() {
            scene.geom(WORLD, rough(GeomBuilder::cuboid(&format!("side {k}"), half).pos(pos), self.friction));
        }
        for (k, solid) in self.solids.iter().enumerate() {
            let name = format!("body {k}");
            let geom = match solid.shape {
                Shape::Ball(radius) => GeomBuilder::sphere(&name, radius),
                Shape::Box(half) => GeomBuilder::cuboid(&name, half),
            };
            let body = BodyBuilder::new(&name).pos(solid.pose.0).quat(solid.pose.1).joint(JointBuilder::free(&name));
            scene.body(WORLD, body.geom(rough(geom.mass(solid.mass), solid.friction)));
        }
        scene.finish().expect("boxes and balls are a valid model")
    }
}

/// Poses of all bodies except the world, in the first environment.
pub(super) fn poses(simulation: &Simulation) -> Vec<Pose> {
    let poses = simulation.body_poses_of(0, &StepInputs::default()).expect("no inputs");
    poses[1..].iter().map(|pose| (pose.pos, pose.quat)).collect()
}

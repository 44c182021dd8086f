//! Where a step's time goes, as the tables of docs/performance.md: stage by stage for every lane type, the floor that arithmetic and memory
//! set, and how the cost grows with degrees of freedom, contacts, environments and threads.

use std::hint::black_box;
use std::sync::Arc;
use std::time::{Duration, Instant};

use stepper_benches::clock::{medians, pin, thread_time};
use stepper_benches::counted::{Counted, Operations};
use stepper_benches::episode::{Episode, single};
use stepper_benches::rig::{Part, Rig, moments};
use stepper_benches::scenes::{Scene, chain};
use stepper_core::internals::compile::{CompiledModel, LaneModel};
use stepper_core::model::{BodyBuilder, GeomBuilder, JointBuilder, Model, WORLD};
use stepper_core::{Level, Options, Precision, Simulation, StepInputs};
use stepper_real::{Real, at_avx512, at_level};

/// Moments of an episode that stages are averaged over.
const MOMENTS: usize = 8;
/// Repeats of a stage at a moment, and of everything else; medians count.
const REPEATS: u64 = 100;
const ROUNDS: usize = 7;
/// Steps after which a humanoid that nobody controls lies on the floor.
const FALL: usize = 200;

fn main() {
    let level = Level::best().expect("STEPPER_CPU_LEVEL names a level of this machine");
    // Before this thread is kept on one core: threads started later inherit that.
    let growth_by_threads = by_threads(level);
    pin();
    let scene = Scene::humanoid();
    stages(&scene, level);
    floor(&scene, level);
    growth("dofs: a chain in the air", [5, 10, 20, 40].map(|n| (n, chain(n))), level);
    growth("contacts: spheres at rest on a floor", [1, 4, 16, 64].map(|n| (n, spheres(n))), level);
    by_environments(&scene, level);
    println!("{growth_by_threads}");
}

/// Times a step of the midpoint rule does each part.
fn calls(part: Part) -> f64 {
    match part {
        Part::MassMatrix | Part::Factor | Part::BiasForce => 0.0,
        Part::Actuate | Part::Acceleration => 2.0,
        _ => 1.0,
    }
}

fn stages(scene: &Scene, level: Level) {
    let columns = [
        at_level!(level, F64x1, stage_times(scene)),
        if level == Level::Avx512 { at_avx512!(F64x16, stage_times(scene)) } else { at_level!(level, F64x8, stage_times(scene)) },
        if level == Level::Avx512 { at_avx512!(F32x32, stage_times(scene)) } else { at_level!(level, F32x16, stage_times(scene)) },
    ];
    let sums = columns.clone().map(|times| Part::ALL.iter().zip(&times).map(|(&part, t)| calls(part) * t).sum::<f64>());
    println!(
        "| stage of the humanoid's step | times | f64 us | f64 lanes us | % | f32 lanes us | f64 lanes are faster by |\n|---|---|---|---|---|---|---|"
    );
    for (k, part) in Part::ALL.into_iter().enumerate() {
        let [a, b, c] = columns.clone().map(|times| times[k]);
        let (times, share) = match calls(part) {
            0.0 => ("within".to_owned(), String::new()),
            n => (format!("{n}"), format!("{:.0}", 100.0 * n * b / sums[1])),
        };
        println!("| {} | {times} | {a:.2} | {b:.3} | {share} | {c:.3} | {:.1} |", part.name(), a / b);
    }
    let [a, b, c] = sums;
    println!("| sum | | {a:.2} | {b:.3} | 100 | {c:.3} | {:.1} |", a / b);
    let mut alone = single(scene);
    let mut wide = [Precision::F64, Precision::F32].map(|precision| Episode::new(scene, 0, 64, precision, level));
    let [double, single_precision] = &mut wide;
    let whole = medians(&mut [&mut alone, double, single_precision], ROUNDS);
    println!("| whole step | | {:.2} | {:.3} | | {:.3} | {:.1} |\n", whole[0], whole[1], whole[2], whole[0] / whole[1]);
}

/// Microseconds per environment of every part.
fn stage_times<R: Real>(scene: &Scene) -> Vec<f64> {
    let compiled = LaneModel::new(&CompiledModel::new(&scene.model));
    let mut rigs: Vec<Rig<R>> = moments(&compiled, scene, MOMENTS);
    let mut time = |part: Part| {
        let mut total = Duration::ZERO;
        for rig in &mut rigs {
            rig.ready(&compiled);
            let rounds = (0..ROUNDS).map(|_| {
                let start = thread_time();
                rig.repeat(&compiled, part, REPEATS);
                thread_time() - start
            });
            total += rounds.min().expect("there are rounds");
        }
        1e6 * total.as_secs_f64() / (REPEATS as f64 * MOMENTS as f64 * R::LANES as f64)
    };
    Part::ALL.into_iter().map(&mut time).collect()
}

/// Operations of the step, what the core does in a second, and the time that no code can be faster than.
fn floor(scene: &Scene, level: Level) {
    let compiled = LaneModel::new(&CompiledModel::new(&scene.model));
    let mut rigs: Vec<Rig<Counted>> = moments(&compiled, scene, MOMENTS);
    let sweeps = at_level!(level, F64x8, rates());
    println!("| part | sums | divisions, roots | others | floor in f64 lanes, us |\n|---|---|---|---|---|");
    let mut all = [0.0; 4];
    for part in Part::ALL.into_iter().filter(|&part| calls(part) > 0.0) {
        let mut done = [0.0; 3];
        for rig in &mut rigs {
            rig.ready(&compiled);
            let found = Operations::of(|| rig.repeat(&compiled, part, 1));
            for (sum, n) in done.iter_mut().zip([found.sums, found.divisions, found.others]) {
                *sum += calls(part) * n as f64 / MOMENTS as f64;
            }
        }
        // Sums and the rest share the vector pipes, divisions and roots have their own.
        let micros = 1e6 * ((done[0] + done[2]) / sweeps[0]).max(done[1] / sweeps[1]);
        println!("| {} | {:.0} | {:.0} | {:.0} | {micros:.3} |", part.name(), done[0], done[1], done[2]);
        all.iter_mut().zip([done[0], done[1], done[2], micros]).for_each(|(sum, x)| *sum += x);
    }
    println!("| sum | {:.0} | {:.0} | {:.0} | {:.3} |\n", all[0], all[1], all[2], all[3]);
    let simulation = Episode::new(scene, 0, 64, Precision::F64, level);
    let bytes = simulation.simulation().bytes() as f64 / 64.0;
    println!(
        "One core: {:.1} G sums/s and {:.2} G divisions/s in f64 lanes, {:.1} GB/s copied.",
        sweeps[0] / 1e9,
        sweeps[1] / 1e9,
        sweeps[2] / 1e9
    );
    println!("State: {bytes:.0} bytes per environment; read and written once a call: {:.3} us at most.\n", 1e6 * 2.0 * bytes / sweeps[2]);
}

/// What this core does in a second: sums, divisions, and bytes copied from memory that no cache of its own holds.
fn rates<R: Real>() -> [f64; 3] {
    [per_second::<R>(false), per_second::<R>(true), copied()]
}

/// Operations a second in independent chains: as many as hide the latency, few enough for the registers.
fn per_second<R: Real>(divide: bool) -> f64 {
    const CHAINS: usize = 12;
    const STEPS: usize = 100_000;
    let run = || {
        R::vectorize(
            #[inline(always)]
            || {
                let mut x = [R::one(); CHAINS];
                let (a, b) = (black_box(R::of(0.999)), black_box(R::of(1e-3)));
                for _ in 0..STEPS {
                    for x in &mut x {
                        *x = if divide { *x / a } else { *x * a + b };
                    }
                }
                black_box(x);
            },
        );
    };
    run();
    let fastest = (0..ROUNDS).map(|_| timed(run)).min().expect("there are rounds");
    (STEPS * CHAINS * R::LANES * if divide { 1 } else { 2 }) as f64 / fastest.as_secs_f64()
}

fn copied() -> f64 {
    let (from, mut to) = (vec![1u8; 1 << 28], vec![0u8; 1 << 28]);
    let fastest = (0..ROUNDS).map(|_| timed(|| to.copy_from_slice(black_box(&from)))).min().expect("there are rounds");
    black_box(&to);
    (1u64 << 28) as f64 / fastest.as_secs_f64()
}

fn timed(work: impl FnOnce()) -> Duration {
    let start = thread_time();
    work();
    thread_time() - start
}

/// So many spheres side by side, each at rest on the floor.
fn spheres(n: usize) -> Arc<Model> {
    let mut scene = Model::builder("spheres");
    scene.timestep(0.005).geom(WORLD, GeomBuilder::plane("floor").masks(1, 1));
    for i in 0..n {
        let body = BodyBuilder::new(&format!("sphere {i}")).pos([i as f64, 0.0, 0.1]).joint(JointBuilder::free(&format!("root {i}")));
        scene.body(WORLD, body.geom(GeomBuilder::sphere(&format!("sphere {i}"), 0.1).masks(1, 0)));
    }
    Arc::new(scene.finish().expect("spheres on a floor are a valid model"))
}

fn simulation(model: &Arc<Model>, num_envs: usize, precision: Precision, threads: usize, level: Level) -> Simulation {
    // One tolerance in both precisions, so that rows compare.
    let options = Options { tolerance: Some(Precision::F64.tolerance()), ..Options::default() };
    Simulation::at_level(model.clone(), options, Some(num_envs), precision, threads, level)
}

/// Microseconds per environment step, from where the environments are.
fn cost(simulation: &mut Simulation, calls: usize, clock: impl Fn() -> Duration) -> f64 {
    let (steps, state) = (calls * simulation.num_envs(), simulation.save_state());
    let mut fastest = Duration::MAX;
    for _ in 0..ROUNDS {
        let start = clock();
        (0..calls).for_each(|_| advance(simulation, 1));
        fastest = fastest.min(clock() - start);
        simulation.restore_state(&state).expect("its own state");
    }
    1e6 * fastest.as_secs_f64() / steps as f64
}

fn advance(simulation: &mut Simulation, nstep: usize) {
    simulation.step(&StepInputs::default(), nstep).expect("no inputs");
}

fn growth(what: &str, models: [(usize, Arc<Model>); 4], level: Level) {
    println!("| {what} | f64 us | f64 lanes us | f32 lanes us |\n|---|---|---|---|");
    for (n, model) in models {
        let time = |num_envs, precision| cost(&mut simulation(&model, num_envs, precision, 1, level), 100, thread_time);
        println!("| {n} | {:.2} | {:.3} | {:.3} |", time(1, Precision::F64), time(64, Precision::F64), time(64, Precision::F32));
    }
    println!();
}

fn by_environments(scene: &Scene, level: Level) {
    println!("| environments: humanoids on the floor | f64 us | f32 us |\n|---|---|---|");
    for n in [1, 2, 8, 16, 64, 1024, 8192] {
        let calls = (20_000 / n).clamp(2, 200);
        let time = |precision| {
            let mut fallen = simulation(&scene.model, n, precision, 1, level);
            advance(&mut fallen, FALL);
            cost(&mut fallen, calls, thread_time)
        };
        println!("| {n} | {:.2} | {:.2} |", time(Precision::F64), time(Precision::F32));
    }
    println!();
}

/// 1,024 humanoids over threads, in turns with one thread.
fn by_threads(level: Level) -> String {
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let model = Scene::humanoid().model;
    let start = Instant::now();
    let mut table = "| threads: 1,024 humanoids | us, wall time | times one thread |\n|---|---|---|\n".to_owned();
    let mut counts: Vec<usize> = std::iter::successors(Some(1), |n| Some(2 * n)).take_while(|&n| n < cores).collect();
    counts.push(cores);
    let mut batches: Vec<Simulation> = counts.iter().map(|&threads| simulation(&model, 1024, Precision::F64, threads, level)).collect();
    batches.iter_mut().for_each(|batch| advance(batch, FALL));
    let mut times = vec![f64::INFINITY; counts.len()];
    for _ in 0..ROUNDS {
        for (batch, least) in batches.iter_mut().zip(&mut times) {
            *least = least.min(cost(batch, 2, || start.elapsed()));
        }
    }
    for (threads, t) in counts.iter().zip(&times) {
        table += &format!("| {threads} | {t:.3} | {:.2} |\n", times[0] / t);
    }
    table
}

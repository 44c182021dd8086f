//! Where a step's time goes, as the tables of docs/performance.md: all of it, part by part for every lane type, the floor that arithmetic
//! and memory set, and how the cost grows with degrees of freedom, contacts, environments and threads.

use std::hint::black_box;
use std::sync::Arc;
use std::time::{Duration, Instant};

use stepper_benches::clock::{medians, pin, thread_time};
use stepper_benches::counted::operations;
use stepper_benches::episode::{Episode, InTurn, single};
use stepper_benches::recorder::{Recording, Row, nanoseconds, own_cost};
use stepper_benches::scenes::{Scene, chain};
use stepper_core::internals::probe::Counter;
use stepper_core::model::{BodyBuilder, GeomBuilder, JointBuilder, Model, WORLD};
use stepper_core::{Level, Options, Precision, Simulation, StepInputs};
use stepper_real::{Real, at_level};

/// Repeats of everything: of each call the fastest counts, of a whole step the median.
const ROUNDS: usize = 15;
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

fn stages(scene: &Scene, level: Level) {
    let wide = |precision| InTurn(vec![Episode::new(scene, 0, 64, precision, level)]);
    let own = own_cost();
    let columns = [single(scene), wide(Precision::F64), wide(Precision::F32)].map(|run| {
        let mut found = run.probe().record(nanoseconds, ROUNDS);
        found.subtract_probe(own);
        found
    });
    let sums = columns.each_ref().map(Recording::sum);
    println!("| part of the humanoid's step | times | f64 us | % | f64 lanes us | % | f32 lanes us | % | f64 lanes are faster by |");
    println!("|---|---|---|---|---|---|---|---|---|");
    let rows = columns.each_ref().map(|found| found.rows().collect::<Vec<_>>());
    for (k, &(name, Row { times, .. })) in rows[0].iter().enumerate() {
        let cells = [0, 1, 2].map(|c| rows[c][k].1.readings[0]);
        if cells.iter().any(|&x| x > 0.0) {
            print(name, &if times > 0.0 { format!("{times:.2}") } else { String::new() }, cells, sums);
        }
    }
    print("sum", "", sums, sums);
    let mut alone = single(scene);
    let mut wide = [Precision::F64, Precision::F32].map(|precision| Episode::new(scene, 0, 64, precision, level));
    let [double, single_precision] = &mut wide;
    let whole = medians(&mut [&mut alone, double, single_precision], ROUNDS);
    println!(
        "| whole step, without a probe | | {:.2} | | {:.3} | | {:.3} | | {:.1} |\n",
        whole[0],
        whole[1],
        whole[2],
        whole[0] / whole[1]
    );
    counters(&columns);
}

/// A row of nanoseconds, as microseconds and per cent.
fn print(name: &str, times: &str, cells: [f64; 3], sums: [f64; 3]) {
    let [a, b, c] = cells.map(|x| 1e-3 * x);
    let [p, q, r] = [0, 1, 2].map(|k| 100.0 * cells[k] / sums[k]);
    println!("| {name} | {times} | {a:.3} | {p:.1} | {b:.4} | {q:.1} | {c:.4} | {r:.1} | {:.1} |", a / b);
}

/// What a step counts: of an environment, or of the group whose lanes share it.
fn counters(columns: &[Recording; 3]) {
    println!("| number in a step | of | f64 | f64 lanes | f32 lanes |\n|---|---|---|---|---|");
    for counter in Counter::ALL.iter().filter(|&&counter| counter != Counter::GroupSteps) {
        let cell = |found: &Recording| {
            let steps = if counter.is_shared() { found.counters[Counter::GroupSteps as usize] } else { 1.0 };
            found.counters[*counter as usize] / steps
        };
        let [a, b, c] = columns.each_ref().map(cell);
        println!("| {} | {} | {a:.2} | {b:.2} | {c:.2} |", counter.name(), if counter.is_shared() { "a group" } else { "an environment" });
    }
    println!();
}

/// Operations of the step, what the core does in a second, and the time that no code can be faster than.
fn floor(scene: &Scene, level: Level) {
    let found = single(scene).probe_operations().record(operations, 1);
    let rates = at_level!(level, F64x8, rates());
    println!("| part | sums | divisions, roots | others | floor in f64 lanes, us |\n|---|---|---|---|---|");
    let mut all = [0.0; 4];
    for (name, Row { readings: [sums, divisions, others], .. }) in found.rows() {
        if sums + divisions + others < 0.5 {
            continue;
        }
        // Sums and the rest share the vector pipes, divisions and roots have their own.
        let micros = 1e6 * ((sums + others) / rates[0]).max(divisions / rates[1]);
        println!("| {name} | {sums:.0} | {divisions:.0} | {others:.0} | {micros:.3} |");
        all.iter_mut().zip([sums, divisions, others, micros]).for_each(|(sum, x)| *sum += x);
    }
    println!("| sum | {:.0} | {:.0} | {:.0} | {:.3} |\n", all[0], all[1], all[2], all[3]);
    let simulation = Episode::new(scene, 0, 64, Precision::F64, level);
    let bytes = simulation.simulation().bytes() as f64 / 64.0;
    println!(
        "One core: {:.1} G sums/s and {:.2} G divisions/s in f64 lanes, {:.1} GB/s copied.",
        rates[0] / 1e9,
        rates[1] / 1e9,
        rates[2] / 1e9
    );
    println!("State: {bytes:.0} bytes per environment; read and written once a call: {:.3} us at most.\n", 1e6 * 2.0 * bytes / rates[2]);
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

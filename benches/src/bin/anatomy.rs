//! Program that measures the time of a step by part.
//!
//! The program prints the tables of docs/benchmarks/performance.md: times for every lane type, and the floor, which is the least time of
//! the arithmetic. Further tables show how the time grows with the number of degrees of freedom, contacts, environments and threads.

use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;
use std::time::{Duration, Instant};

use stepper_benches::clock::{medians, pin, thread_time};
use stepper_benches::counted::operations;
use stepper_benches::episode::{Episode, InTurn, single};
use stepper_benches::floor::{Rates, copied};
use stepper_benches::parts::Anatomy;
use stepper_benches::recorder::{Recording, Row, nanoseconds, own_cost};
use stepper_benches::replay::Replay;
use stepper_benches::report::{cpu, exit_code};
use stepper_benches::scenes::{Scene, chain};
use stepper_core::internals::probe::{Counter, Span};
use stepper_core::model::{BodyBuilder, GeomBuilder, JointBuilder, Model, WORLD};
use stepper_core::{Level, Options, Precision, Simulation, StepInputs};

/// Number of repeats of each measurement. The smallest time counts, except for the whole step of the humanoid, whose table shows the
/// median.
const ROUNDS: usize = 15;
/// Smallest floor (least time of the arithmetic) of a part of the step that the tables show, us. Smaller values give empty cells.
const WORTH_A_CELL: f64 = 5e-4;
/// Number of steps without control after which a humanoid lies on the floor.
const FALL: usize = 200;

const USAGE: &str = "usage: anatomy [--episode FOLDER... [--json FILE]]

Prints the time of each stage of a step, its lower bound, and its growth with the size of the scene. The scene is the humanoid, or
  --episode FOLDER...  recordings by sim.record(FOLDER). Recordings with the same name (the note, else the folder's name) share a table
  --json FILE          also writes the results of the recordings as JSON";

fn main() -> ExitCode {
    exit_code(run().map(|()| ExitCode::SUCCESS))
}

fn run() -> Result<(), String> {
    let (mut folders, mut json) = (vec![], None);
    let mut words = std::env::args().skip(1).peekable();
    while let Some(word) = words.next() {
        match word.as_str() {
            "--json" => json = Some(PathBuf::from(words.next().ok_or(USAGE)?)),
            "--episode" => {
                while let Some(folder) = words.next_if(|word| !word.starts_with("--")) {
                    folders.push(PathBuf::from(folder));
                }
            }
            _ => return Err(USAGE.into()),
        }
    }
    let level = Level::best().map_err(|e| e.to_string())?;
    if !folders.is_empty() {
        return episodes(&folders, json, level);
    }
    if json.is_some() {
        return Err(USAGE.into());
    }
    humanoid(level);
    Ok(())
}

fn humanoid(level: Level) {
    // Measure several threads before the pinning to one core, because threads that start later inherit the pinning.
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

/// Measures the recorded episodes in `folders`, and prints a table of the step's parts for each episode, and a table of all episodes.
///
/// Recordings of the same episode in f64 and in f32 are columns of the same table. `json` is the JSON file to which the results are
/// written; `None` writes no file.
fn episodes(folders: &[PathBuf], json: Option<PathBuf>, level: Level) -> Result<(), String> {
    pin();
    let (mut found, mut refused): (Vec<Anatomy>, Vec<String>) = (vec![], vec![]);
    for folder in folders {
        eprintln!("{}", folder.display());
        let anatomy = Replay::load(folder).and_then(|replay| Anatomy::of(&replay, level).map_err(|e| format!("{}: {e}", folder.display())));
        match anatomy {
            Ok(anatomy) => found.push(anatomy),
            Err(message) => {
                refused.push(message);
                continue;
            }
        }
        // The results so far are written after each recording, so that a later failure does not lose them.
        if let Some(path) = &json {
            let text = serde_json::json!({ "cpu": cpu(), "cpu_level": level.to_string(), "episodes": found });
            std::fs::write(path, format!("{text:#}\n")).map_err(|e| format!("{}: {e}", path.display()))?;
        }
    }
    // Sort by name and number of environments, f64 before f32.
    found.sort_by(|a, b| (&a.name, a.num_envs, b.precision).cmp(&(&b.name, b.num_envs, a.precision)));
    let same = |a: &Anatomy, b: &Anatomy| (&a.name, a.num_envs) == (&b.name, b.num_envs);
    for columns in found.chunk_by(same) {
        parts(columns);
    }
    println!("| episode | us f64 / f32 | floor f64 / f32 | times the floor f64 / f32 |\n|---|---|---|---|");
    for columns in found.chunk_by(same) {
        let both = |value: &dyn Fn(&Anatomy) -> String| {
            let cell = |precision: &str| columns.iter().find(|a| a.precision == precision).map_or("-".into(), value);
            format!("{} / {}", cell("f64"), cell("f32"))
        };
        let ratio = both(&|a| format!("{:.1}", a.micros / a.floor));
        let [micros, floor] = [both(&|a| format!("{:.3}", a.micros)), both(&|a| format!("{:.3}", a.floor))];
        println!("| {}, {} environments | {micros} | {floor} | {ratio} |", columns[0].name, columns[0].num_envs);
    }
    for a in found.iter().filter(|a| !a.reproduced) {
        println!("\n{}, {}: it ends elsewhere than it did; another build of stepper recorded it.", a.name, a.precision);
    }
    if refused.is_empty() { Ok(()) } else { Err(refused.join("\n")) }
}

/// Prints two tables of an episode: times of the step's parts, and numbers of events such as contacts. `columns` has the measurements in
/// each precision.
fn parts(columns: &[Anatomy]) {
    let line = |first: &str, cells: &dyn Fn(&Anatomy) -> String| {
        let cells: Vec<String> = columns.iter().map(cells).collect();
        println!("| {first} | {} |", cells.join(" | "));
    };
    let rule = |cells: usize| println!("|---|{}", "---|".repeat(cells * columns.len()));
    println!("### {}, {} environments in lanes\n", columns[0].name, columns[0].num_envs);
    line("part", &|a| format!("{0} times | {0} us | % | floor us | times the floor", a.precision));
    rule(5);
    let names: Vec<&str> = Span::ALL.iter().map(|span| span.name()).chain(["unaccounted"]).collect();
    for name in names.into_iter().filter(|name| columns.iter().any(|a| a.parts.iter().any(|part| part.name == *name))) {
        line(name, &|a| {
            let Some(part) = a.parts.iter().find(|part| part.name == name) else { return " | | | | ".into() };
            let share = 100.0 * part.micros / a.parts.iter().map(|part| part.micros).sum::<f64>();
            let floor =
                if part.floor > WORTH_A_CELL { format!("{:.4} | {:.1}", part.floor, part.micros / part.floor) } else { " | ".into() };
            format!("{:.2} | {:.4} | {share:.1} | {floor}", part.times, part.micros)
        });
    }
    line("whole step, without a probe", &|a| format!(" | {:.4} | | {:.4} | {:.1}", a.micros, a.floor, a.micros / a.floor));
    println!();
    line("number in a step | of", &|a| a.precision.into());
    println!("|---|---|{}", "---|".repeat(columns.len()));
    for (k, count) in columns[0].counts.iter().enumerate() {
        let of = if count.shared { "a group" } else { "an environment" };
        line(&format!("{} | {of}", count.name), &|a| format!("{:.2}", a.counts[k].mean));
    }
    println!();
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

/// Prints a table row with the times of one part of the step in three lane types, in us and in per cent of the whole step.
///
/// `times` is the text of the number of times that the part runs per step. `cells` are the times of the part per step, ns, and `sums` the
/// times of all parts together, ns.
fn print(name: &str, times: &str, cells: [f64; 3], sums: [f64; 3]) {
    let [a, b, c] = cells.map(|x| 1e-3 * x);
    let [p, q, r] = [0, 1, 2].map(|k| 100.0 * cells[k] / sums[k]);
    println!("| {name} | {times} | {a:.3} | {p:.1} | {b:.4} | {q:.1} | {c:.4} | {r:.1} | {:.1} |", a / b);
}

/// Prints a table of the mean numbers of events in a step, such as contacts, for three lane types.
///
/// A table row counts either per environment or per SIMD group of environments.
fn counters(columns: &[Recording; 3]) {
    println!("| number in a step | of | f64 | f64 lanes | f32 lanes |\n|---|---|---|---|---|");
    for counter in Counter::ALL.iter().filter(|&&counter| counter != Counter::GroupSteps) {
        let [a, b, c] = columns.each_ref().map(|found| found.mean(*counter));
        println!("| {} | {} | {a:.2} | {b:.2} | {c:.2} |", counter.name(), if counter.is_shared() { "a group" } else { "an environment" });
    }
    println!();
}

/// Prints a table of the floor of a step in the scene: numbers of arithmetic operations in each part of the step, and the time that they
/// would take at the measured peak rates of the core.
fn floor(scene: &Scene, level: Level) {
    let found = single(scene).probe_operations().record(operations, 1);
    let rates = Rates::measure(Precision::F64, level);
    println!("| part | sums | divisions, roots | others | floor in f64 lanes, us |\n|---|---|---|---|---|");
    let mut all = [0.0; 4];
    for (name, Row { readings, .. }) in found.rows() {
        let [sums, divisions, others] = readings;
        if sums + divisions + others < 0.5 {
            continue;
        }
        let micros = rates.micros(readings);
        println!("| {name} | {sums:.0} | {divisions:.0} | {others:.0} | {micros:.3} |");
        all.iter_mut().zip([sums, divisions, others, micros]).for_each(|(sum, x)| *sum += x);
    }
    println!("| sum | {:.0} | {:.0} | {:.0} | {:.3} |\n", all[0], all[1], all[2], all[3]);
    let simulation = Episode::new(scene, 0, 64, Precision::F64, level);
    let bytes = simulation.simulation().bytes() as f64 / 64.0;
    let (sums, divisions, copied) = (rates.sums / 1e9, rates.divisions / 1e9, copied());
    println!("One core: {sums:.1} G sums/s and {divisions:.2} G divisions/s in f64 lanes, {:.1} GB/s copied.", copied / 1e9);
    println!("State: {bytes:.0} bytes per environment; read and written once a call: {:.3} us at most.\n", 1e6 * 2.0 * bytes / copied);
}

/// Model of n spheres with a free joint each. They rest on the floor in a row, without touching each other.
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
    Simulation::at_level(model.clone(), Options::default(), Some(num_envs), precision, threads, level)
}

/// Time per environment step, us, in the fastest of [`ROUNDS`] runs of `calls` steps from the current state.
///
/// `clock` is the function that reads the time. At the end, the simulation is in the same state as before.
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

/// Table of the step time of 1,024 humanoids for several numbers of threads. The runs take turns, so that other load affects all runs
/// alike.
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

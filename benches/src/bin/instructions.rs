//! Instructions per environment step, counted by valgrind's callgrind. The counts do not depend on the load of the machine, so that
//! regressions are visible.

use std::collections::BTreeMap;
use std::ffi::{CStr, CString};
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};

use serde::{Deserialize, Serialize};
use stepper_benches::clock::Run;
use stepper_benches::derivative::Derivatives;
use stepper_benches::episode::{Episode, single};
use stepper_benches::recorder::{READINGS, Recorder, Recording, record};
use stepper_benches::report::{exit_code, rustc};
use stepper_benches::scenes::Scene;
use stepper_core::StepInputs;
use stepper_core::internals::probe::{Probe, Span};
use stepper_core::{Level, Precision};

const USAGE: &str = "usage: instructions [--save [FILE]] [--against FILE]

Prints instructions per environment step of whole steps, of derivatives of the ant's, and of the parts of the humanoid's, and their ratio to those that were kept.
Needs valgrind. The counts belong to a compiler and a CPU level, not to a machine or its load. Counts more than 1 % above those that were kept are
marked with \"<\", and the exit code is 2 unless they are saved; with kept counts of another compiler or CPU level there is no verdict.
  --save [FILE]    also writes them as JSON (default benches/instructions.json)
  --against FILE   counts to compare with (default benches/instructions.json, if it is there)";

/// Command-line argument with which this program starts itself under callgrind to run the counted work.
const WORK: &str = "--work";
/// Number of counted steps per environment of [`single`], at different times of the episode.
const MOMENTS: usize = 4;
/// Number of uncounted steps before each counted step.
const APART: usize = 20;

/// Relative increase of a count above which the table marks it. Counts of one build are reproducible. Recompilation of unrelated code
/// changes them by less than this limit.
const GREW: f64 = 0.01;

/// Instruction counts by name, as in the JSON file, with compiler and CPU level.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct Counts {
    rustc: String,
    arch: String,
    /// CPU level (such as AVX2) with which single environments are stepped: the best level that valgrind supports, so not AVX-512.
    level: String,
    instructions: BTreeMap<String, f64>,
}

fn main() -> ExitCode {
    if std::env::args().nth(1).as_deref() == Some(WORK) {
        work();
        return ExitCode::SUCCESS;
    }
    exit_code(run().map(|kept| if kept { ExitCode::SUCCESS } else { ExitCode::from(2) }))
}

/// Counts the instructions, prints a table, and saves it if requested. The result is true if no count increased by more than [`GREW`], or
/// if the counts were saved.
fn run() -> Result<bool, String> {
    let kept = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("instructions.json");
    let (mut save, mut against) = (None, None);
    let mut words = std::env::args().skip(1).peekable();
    while let Some(word) = words.next() {
        match word.as_str() {
            "--save" => save = Some(words.next_if(|w| !w.starts_with("--")).map_or_else(|| kept.clone(), PathBuf::from)),
            "--against" => against = Some(PathBuf::from(words.next().ok_or(USAGE)?)),
            _ => return Err(USAGE.into()),
        }
    }
    let before = match against {
        Some(path) => Some(load(&path)?),
        None => kept.exists().then(|| load(&kept)).transpose()?,
    };
    let found = count()?;
    let grew = print(&found, before.as_ref());
    let saved = save.is_some();
    if let Some(path) = save {
        let text = serde_json::to_string_pretty(&found).map_err(|e| e.to_string())? + "\n";
        std::fs::write(&path, text).map_err(|e| format!("{}: {e}", path.display()))?;
        println!("\nsaved to {}", path.display());
    }
    Ok(saved || grew == 0)
}

fn load(path: &Path) -> Result<Counts, String> {
    let text = std::fs::read_to_string(path).map_err(|e| format!("{}: {e}", path.display()))?;
    serde_json::from_str(&text).map_err(|e| format!("{}: {e}", path.display()))
}

/// Prints a table of the instruction counts `found`, and of their ratios to the earlier counts `before`, if there are any.
///
/// The result is the number of counts that increased by more than [`GREW`]; 0 if the counts of `before` have another compiler or CPU level.
fn print(found: &Counts, before: Option<&Counts>) -> usize {
    let of = |c: &Counts| [&c.rustc[..], &c.arch, &c.level].join(", ");
    let kept = before.map_or_else(String::new, |b| format!("; kept ones: {}", of(b)));
    println!("instructions per environment step; {}{kept}\n{:<48}{:>12}{:>10}", of(found), "", "count", "ratio");
    let judged = before.is_some_and(|b| of(b) == of(found));
    let mut grew = 0;
    for (name, count) in &found.instructions {
        let ratio = before.and_then(|b| b.instructions.get(name)).map(|was| count / was);
        let marked = judged && ratio.is_some_and(|ratio| ratio > 1.0 + GREW);
        grew += usize::from(marked);
        let (ratio, mark) = (ratio.map_or_else(|| "new".into(), |ratio| format!("{ratio:.3}")), if marked { " <" } else { "" });
        println!("{name:<48}{count:>12.0}{ratio:>10}{mark}");
    }
    match judged {
        true => println!("\n{grew} counts grew by more than {:.0} %", 100.0 * GREW),
        false => println!("\nno verdict: there are no kept counts of this compiler and CPU level"),
    }
    grew
}

/// Counts the instructions per environment step of all measured work, by name.
///
/// The function starts this program again under callgrind. That process makes callgrind write its instruction counters to a file after
/// each piece of work, and this function reads the file.
fn count() -> Result<Counts, String> {
    let folder = std::env::temp_dir().join(format!("stepper-instructions-{}", std::process::id()));
    std::fs::create_dir_all(&folder).map_err(|e| format!("{}: {e}", folder.display()))?;
    let me = std::env::current_exe().map_err(|e| e.to_string())?;
    let output = Command::new("valgrind")
        .args(["--tool=callgrind", "--combine-dumps=yes", "--dump-line=no"])
        .arg(format!("--callgrind-out-file={}", folder.join("out").display()))
        .arg(me)
        .arg(WORK)
        .output()
        .map_err(|e| format!("valgrind cannot be started ({e}); it counts the instructions: apt-get install valgrind"))?;
    if !output.status.success() {
        return Err(format!("valgrind: {}", String::from_utf8_lossy(&output.stderr)));
    }
    let text = String::from_utf8_lossy(&output.stdout);
    let mut lines = text.lines();
    let level = lines.next().unwrap_or_default().to_owned();
    let counted = totals(&folder.join("out"))?;
    let [inside, outside] = EMPTY.map(|name| counted.get(name).map_or(0.0, |total| total / EMPTY_SPANS as f64));
    let mut instructions = BTreeMap::new();
    for line in lines {
        let unexpected = || format!("unexpected output: {line}");
        let mut words = line.splitn(4, ' ');
        let mut number = || words.next().and_then(|word| word.parse::<f64>().ok()).ok_or_else(unexpected);
        let (steps, times, inner) = (number()?, number()?, number()?);
        let name = words.next().ok_or_else(unexpected)?;
        if let Some(total) = counted.get(name) {
            instructions.insert(name.to_owned(), (total - times * inside - inner * outside) / steps);
        }
    }
    std::fs::remove_dir_all(&folder).map_err(|e| format!("{}: {e}", folder.display()))?;
    if instructions.is_empty() {
        Err("valgrind has counted nothing".into())
    } else {
        Ok(Counts { rustc: rustc(), arch: std::env::consts::ARCH.into(), level, instructions })
    }
}

/// Sums of the instruction counts in callgrind's output file by name, over all requests of [`write_down`] with the same name.
fn totals(path: &Path) -> Result<BTreeMap<String, f64>, String> {
    let text = std::fs::read_to_string(path).map_err(|e| format!("{}: {e}", path.display()))?;
    let (mut sums, mut name) = (BTreeMap::new(), None);
    for line in text.lines() {
        if let Some(trigger) = line.strip_prefix("desc: Trigger: ") {
            name = trigger.strip_prefix("Client Request: ");
        } else if let (Some(total), Some(name)) = (line.strip_prefix("totals: "), name) {
            let total: f64 = total.trim().parse().map_err(|_| format!("{}: unexpected line: {line}", path.display()))?;
            *sums.entry(name.to_owned()).or_default() += total;
        }
    }
    Ok(sums)
}

/// Makes callgrind write the number of instructions since the previous call of this function to callgrind's output file, with a name.
///
/// Without valgrind the function does nothing.
#[cfg(all(target_arch = "x86_64", target_os = "linux"))]
fn write_down(name: &CStr) {
    /// Request code CALLGRIND_DUMP_STATS_AT of valgrind/callgrind.h: the letters of the tool, and the number of the request.
    const DUMP_STATS_AT: usize = (b'C' as usize) << 24 | (b'T' as usize) << 16 | 3;
    let request = [DUMP_STATS_AT, name.as_ptr() as usize, 0, 0, 0, 0];
    // SAFETY: valgrind reads six words from the address in rax and a string that ends with 0. Both live until here. It writes rdx. Without
    // valgrind, the rotations of rdi add up to twice its width, and the exchange of rbx with itself does nothing.
    unsafe {
        std::arch::asm!(
            "rol rdi, 3", "rol rdi, 13", "rol rdi, 61", "rol rdi, 51", "xchg rbx, rbx",
            in("rax") request.as_ptr(), inout("rdx") 0usize => _,
        );
    }
}

fn text(name: &str) -> CString {
    CString::new(name).expect("a name has no zero byte")
}

/// Does nothing, because requests to callgrind are only implemented for Linux on x86-64.
#[cfg(not(all(target_arch = "x86_64", target_os = "linux")))]
fn write_down(_: &CStr) {}

/// Runs all work whose instructions callgrind counts.
///
/// The function first prints the CPU level. It then prints a line for each part of a step whose instructions callgrind counts. The line
/// has the number of environment steps, how often the part ran, how many other counted parts ran inside it, and its name.
fn work() {
    let level = *Level::available().last().expect("the baseline is always available");
    println!("{level}");
    for scene in Scene::all() {
        whole(&format!("{} f64", scene.name), single(&scene));
        if Level::available().contains(&Level::Avx2) {
            whole(&format!("{} F64x8 avx2", scene.name), Episode::new(&scene, 0, 8, Precision::F64, Level::Avx2));
        }
    }
    let ant = Scene::ant();
    whole("ant f64, derivative", Derivatives::new(&ant, 1, level));
    if Level::available().contains(&Level::Avx2) {
        whole("ant F64x8 avx2, derivative", Derivatives::new(&ant, 8, Level::Avx2));
    }
    parts();
}

/// Prefix of the names under which the parts of a humanoid's step are counted.
const PARTS: &str = "humanoid f64, ";

/// Names of the two counts that measure the cost of the instrumentation.
///
/// The first count has the instructions inside empty spans (instrumented parts without work), the second those that begin and end these
/// spans.
const EMPTY: [&str; 2] = ["inside an empty span", "outside of it"];
/// Number of empty spans in the measurement of the cost of the instrumentation.
const EMPTY_SPANS: usize = 1000;

fn name_of(part: Option<Span>) -> &'static str {
    part.map_or("unaccounted", Span::name)
}

thread_local! {
    // The names exist before the first reading, so that a boundary of a span costs the same in every part.
    static PART_NAMES: Vec<CString> =
        Span::ALL.iter().copied().map(Some).chain([None]).map(|span| text(&format!("{PARTS}{}", name_of(span)))).collect();
    static EMPTY_NAMES: [CString; 2] = EMPTY.map(text);
}

/// Meter for a [`Recorder`]: makes callgrind write the instruction counts since the last reading under the name of the part `span`.
fn part_ends(span: Option<Span>) -> [u64; READINGS] {
    PART_NAMES.with(|names| write_down(&names[span.map_or(Span::ALL.len(), |span| span as usize)]));
    [0; READINGS]
}

/// Meter for a [`Recorder`] that measures the cost of the instrumentation itself, with empty spans.
///
/// Callgrind writes the instruction counts since the last call of this function: under the first name of [`EMPTY`] if `span` has just
/// ended, and under the second one for the code outside all spans (`None`). The returned readings are zeros, because callgrind keeps the
/// counts.
fn empty_ends(span: Option<Span>) -> [u64; READINGS] {
    EMPTY_NAMES.with(|names| write_down(&names[usize::from(span.is_none())]));
    [0; READINGS]
}

/// Runs counted steps of the humanoid with instrumentation by a [`Recorder`], so that callgrind counts each part of a step.
fn parts() {
    let mut run = single(&Scene::humanoid()).probe();
    run.run();
    run.rewind();
    PART_NAMES.with(|_| ());
    EMPTY_NAMES.with(|_| ());
    let mut sum = Recording::default();
    for episode in &mut run.0 {
        let mut step = |steps| episode.simulation_mut().step(&StepInputs::default(), steps).map(drop).expect("controls in force");
        for _ in 0..MOMENTS {
            step(APART);
            write_down(&text(NOTHING));
            sum.add(&record(part_ends, || step(1)), 1.0);
        }
    }
    for (name, row) in sum.rows() {
        println!("{} {} {} {PARTS}{name}", run.0.len() * MOMENTS, row.times, row.inner);
    }
    write_down(&text(NOTHING));
    record(empty_ends, || (0..EMPTY_SPANS).for_each(|_| Recorder.span(Span::Accept, || ())));
}

fn whole(name: &str, mut run: impl Run) {
    // An uncounted first run allocates memory.
    run.run();
    run.rewind();
    let name_of_run = text(name);
    write_down(&text(NOTHING));
    run.run();
    write_down(&name_of_run);
    println!("{} 0 0 {name}", run.environment_steps());
}

/// Name under which callgrind writes the instructions before the counted work. Counts of this name are ignored.
const NOTHING: &str = "";

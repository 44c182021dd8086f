//! Instructions per environment step, counted by valgrind's callgrind: the same on a busy machine, so that a regression shows.

use std::collections::BTreeMap;
use std::hint::black_box;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};

use serde::{Deserialize, Serialize};
use stepper_benches::clock::Run;
use stepper_benches::episode::{Episode, single};
use stepper_benches::report::rustc;
use stepper_benches::rig::{Part, Rig, moments};
use stepper_benches::scenes::Scene;
use stepper_core::internals::compile::{CompiledModel, LaneModel};
use stepper_core::{Level, Precision};
use stepper_real::{Real, at_level};

const USAGE: &str = "usage: instructions [--save [FILE]] [--against FILE]

Prints instructions per environment step of whole steps and of the humanoid's stages, and their ratio to those that were kept.
Needs valgrind. The counts belong to a compiler and a CPU level, not to a machine or its load. Counts more than 1 % above those that were kept are
marked with \"<\", and the exit code is 2 unless they are saved; with kept counts of another compiler or CPU level there is no verdict.
  --save [FILE]    also writes them as JSON (default benches/instructions.json)
  --against FILE   counts to compare with (default benches/instructions.json, if it is there)";

/// The word that makes this program do the work that is counted.
const WORK: &str = "--work";
/// Moments of an episode that a stage is counted at.
const MOMENTS: usize = 8;

/// Growth of a count that is marked. Counts of one build repeat to the last digit; what compilers do with code nearby moves them by less.
const GREW: f64 = 0.01;

/// What is kept.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct Counts {
    rustc: String,
    arch: String,
    /// CPU level of the stages: the best that valgrind knows, which has no AVX-512.
    level: String,
    instructions: BTreeMap<String, f64>,
}

fn main() -> ExitCode {
    if std::env::args().nth(1).as_deref() == Some(WORK) {
        work();
        return ExitCode::SUCCESS;
    }
    match run() {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::from(2),
        Err(message) => {
            eprintln!("{message}");
            ExitCode::FAILURE
        }
    }
}

/// Whether no count grew, or whatever it found was saved.
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

/// Prints the table, and returns how many counts grew by more than [`GREW`].
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

/// Runs this program under callgrind, which writes one file each time that `counted` returns.
fn count() -> Result<Counts, String> {
    let folder = std::env::temp_dir().join(format!("stepper-instructions-{}", std::process::id()));
    std::fs::create_dir_all(&folder).map_err(|e| format!("{}: {e}", folder.display()))?;
    let me = std::env::current_exe().map_err(|e| e.to_string())?;
    let output = Command::new("valgrind")
        // Two patterns for one function: valgrind 3.19 forgets the first of two options with the same pattern.
        .args(["--tool=callgrind", "--toggle-collect=*counted*", "--dump-after=instructions::counted*"])
        .arg(format!("--callgrind-out-file={}", folder.join("out").display()))
        .arg(me)
        .arg(WORK)
        .output()
        .map_err(|e| format!("valgrind cannot be started ({e}); it counts the instructions: apt-get install valgrind"))?;
    if !output.status.success() {
        return Err(format!("valgrind: {}", String::from_utf8_lossy(&output.stderr)));
    }
    let mut instructions = BTreeMap::new();
    let text = String::from_utf8_lossy(&output.stdout);
    let mut lines = text.lines();
    let level = lines.next().unwrap_or_default().to_owned();
    for (k, line) in lines.enumerate() {
        let (steps, name) = line.split_once(' ').ok_or_else(|| format!("unexpected output: {line}"))?;
        let steps: f64 = steps.parse().map_err(|_| format!("unexpected output: {line}"))?;
        instructions.insert(name.to_owned(), total(&folder.join(format!("out.{}", k + 1)))? / steps);
    }
    std::fs::remove_dir_all(&folder).map_err(|e| format!("{}: {e}", folder.display()))?;
    Ok(Counts { rustc: rustc(), arch: std::env::consts::ARCH.into(), level, instructions })
}

/// Instructions that a file of callgrind's sums up to.
fn total(path: &Path) -> Result<f64, String> {
    let text = std::fs::read_to_string(path).map_err(|e| format!("{}: {e}", path.display()))?;
    let number = |line: &str| line.strip_prefix("totals: ").or(line.strip_prefix("summary: "))?.split_whitespace().next()?.parse().ok();
    text.lines().find_map(number).ok_or_else(|| format!("{} has no total", path.display()))
}

/// All that is counted; says the CPU level, then of each what it is and how many environment steps it was.
fn work() {
    let level = *Level::available().last().expect("the baseline is always available");
    println!("{level}");
    for scene in Scene::all() {
        whole(&format!("{} f64", scene.name), single(&scene));
        if Level::available().contains(&Level::Avx2) {
            whole(&format!("{} F64x8 avx2", scene.name), Episode::new(&scene, 0, 8, Precision::F64, Level::Avx2));
        }
    }
    at_level!(level, F64x1, stages());
}

/// The stages of the humanoid's step.
fn stages<R: Real<Scalar = f64>>() {
    let scene = Scene::humanoid();
    let compiled = LaneModel::new(&CompiledModel::new(&scene.model));
    let mut rigs: Vec<Rig<R>> = moments(&compiled, &scene, MOMENTS);
    for part in Part::ALL {
        rigs.iter_mut().for_each(|rig| rig.ready(&compiled));
        counted(&mut || rigs.iter_mut().for_each(|rig| rig.repeat(&compiled, part, 1)));
        println!("{MOMENTS} humanoid f64, {}", part.name());
    }
}

fn whole(name: &str, mut run: impl Run) {
    // Once before, so that what the first run makes is there.
    run.run();
    run.rewind();
    counted(&mut || run.run());
    println!("{} {name}", run.environment_steps());
}

/// What callgrind counts. Something is left to do after the work, so that it is a call with a return and not a jump.
#[inline(never)]
fn counted(work: &mut dyn FnMut()) {
    work();
    black_box(work);
}

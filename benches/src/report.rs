//! Report of ratios of speeds, measured in one run: printed as a table, and saved as a file for later comparison.
//!
//! Times depend on the machine and its load. Ratios of runs that took turns depend less on machine and load, so the report stores and
//! compares ratios.

use std::io;
use std::path::Path;
use std::process::ExitCode;

use serde::{Deserialize, Serialize};
use stepper_core::{Level, Precision};

use crate::clock::{Run, medians};
use crate::episode::{lanes, single};
use crate::peers::{Course, entries};
use crate::scenes::Scene;

/// Relative decrease of a ratio above which it is marked. On a quiet machine, ratios repeat within a few per cent.
pub const SLOWER: f64 = 0.1;

/// Report of a benchmark run: all groups of rows, and the machine.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Report {
    /// Machine and build of the measurement.
    pub machine: Machine,
    /// Groups with the times of whole steps, one for each scene.
    pub steps: Vec<Group>,
    /// Groups of the comparison with rapier, one for each scene. Each row is an engine with a setting.
    pub peers: Vec<Group>,
}

/// Machine and build of a measurement.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Machine {
    /// Model of the processor.
    pub cpu: String,
    /// Number of processors.
    pub cores: usize,
    /// Available CPU levels, the slowest first.
    pub levels: Vec<String>,
    /// Version of the compiler.
    pub rustc: String,
    /// Commit of the repository, and whether it had changes.
    pub commit: String,
    /// Number of rounds from which the medians were taken.
    pub rounds: usize,
}

/// Group of rows in a report, whose speeds are relative to the first row.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Group {
    /// Name of the scene.
    pub name: String,
    /// Names of the errors, if errors were measured.
    pub measures: Option<[String; 2]>,
    /// Rows of the group. The first row is the reference of the ratios.
    pub rows: Vec<Row>,
}

/// Row of a report: time of an engine, lane type or setting.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Row {
    /// Name of the engine, lane type or setting.
    pub name: String,
    /// Median processor time per environment step, us.
    pub micros: f64,
    /// Speed of this row divided by the speed of the first row of its group.
    pub ratio: f64,
    /// Errors of the engine in the scene, if they were measured.
    pub errors: Option<[f64; 2]>,
}

impl Report {
    /// Measures all groups. Each median is over `rounds` rounds, in which the runs of a group take turns.
    pub fn measure(rounds: usize) -> Self {
        Self {
            machine: Machine::this(rounds),
            steps: Scene::all().iter().map(|scene| steps(scene, rounds)).collect(),
            peers: Course::ALL.into_iter().map(|course| peers(course, rounds)).collect(),
        }
    }

    /// Checks that this report is comparable with measurements on this machine.
    ///
    /// # Errors
    /// If the CPU levels differ. The first row of a group, to which ratios are relative, runs on the best level, so ratios differ then.
    pub fn comparable(&self) -> Result<(), String> {
        let (then, now) = (&self.machine.levels, Machine::this(0).levels);
        if *then == now {
            return Ok(());
        }
        let (then, now) = (then.join(", "), now.join(", "));
        Err(format!(
            "it is of the CPU levels {then}, and this machine and build have {now}: ratios of one do not compare with those of the other"
        ))
    }

    /// Prints the tables of the report.
    ///
    /// `before` is an earlier report. With it, the tables show the earlier value after each ratio, if there is one, and mark the ratios
    /// that have decreased by more than [`SLOWER`].
    pub fn print(&self, before: Option<&Self>) {
        let m = &self.machine;
        println!("{}, {} cores, one used; levels {}; {}; commit {}", m.cpu, m.cores, m.levels.join(", "), m.rustc, m.commit);
        println!("medians of {} rounds of processor time, per environment step", m.rounds);
        if let Some(Self { machine: b, .. }) = before {
            println!(
                "column \"was\": {}; {}; commit {}; \"<\" marks a ratio more than {:.0} % below it",
                b.cpu,
                b.rustc,
                b.commit,
                100.0 * SLOWER
            );
        }
        let all = self.steps.iter().chain(&self.peers);
        let fell: usize = all.map(|group| group.print(before.and_then(|b| b.group(&group.name)))).sum();
        if before.is_some() {
            println!("\n{fell} ratios fell by more than {:.0} %", 100.0 * SLOWER);
        }
    }

    fn group(&self, name: &str) -> Option<&Group> {
        self.steps.iter().chain(&self.peers).find(|g| g.name == name)
    }

    /// Writes the report to a JSON file.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn save(&self, path: &Path) -> io::Result<()> {
        std::fs::write(path, serde_json::to_string_pretty(self)? + "\n")
    }

    /// Reads a report from a JSON file.
    ///
    /// # Errors
    /// If the file contains no report.
    pub fn load(path: &Path) -> io::Result<Self> {
        Ok(serde_json::from_str(&std::fs::read_to_string(path)?)?)
    }
}

impl Machine {
    fn this(rounds: usize) -> Self {
        Self {
            cpu: cpu(),
            cores: processors().lines().filter(|l| l.starts_with("processor")).count(),
            levels: Level::available().iter().map(Level::to_string).collect(),
            rustc: rustc(),
            commit: says("git", &["describe", "--always", "--dirty"]),
            rounds,
        }
    }
}

fn processors() -> String {
    std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default()
}

/// Name of the processor's model, or the name of its architecture if the system does not report a model.
pub fn cpu() -> String {
    let info = processors();
    let model = info.lines().find_map(|l| l.strip_prefix("model name")).and_then(|l| l.split_once(": "));
    model.map_or_else(|| std::env::consts::ARCH.into(), |(_, name)| name.into())
}

/// Version of the Rust compiler.
pub fn rustc() -> String {
    says("rustc", &["--version"])
}

/// Output of a program without white space at both ends, or "unknown" if there is no output.
fn says(program: &str, arguments: &[&str]) -> String {
    let output = std::process::Command::new(program).args(arguments).current_dir(env!("CARGO_MANIFEST_DIR")).output();
    let text = output.map(|o| String::from_utf8_lossy(&o.stdout).trim().to_owned()).unwrap_or_default();
    if text.is_empty() { "unknown".into() } else { text }
}

impl Group {
    fn new(name: String, measures: Option<[String; 2]>, rows: Vec<(String, f64, Option<[f64; 2]>)>) -> Self {
        let first = rows.first().map_or(0.0, |&(_, micros, _)| micros);
        let row = |(name, micros, errors)| Row { name, micros, ratio: first / micros, errors };
        Self { name, measures, rows: rows.into_iter().map(row).collect() }
    }

    /// Prints the table of the group, and returns the number of ratios that are marked as slower than in the earlier group `before`.
    fn print(&self, before: Option<&Self>) -> usize {
        let mut marked = 0;
        let [a, b] = self.measures.clone().unwrap_or_default();
        println!("\n{:<48}{:>10}{:>9}{:>9}{a:>20}{b:>20}", self.name, "us", "ratio", if before.is_some() { "was" } else { "" });
        for row in &self.rows {
            let was = before.and_then(|b| b.rows.iter().find(|r| r.name == row.name)).map(|r| r.ratio);
            let fell = was.is_some_and(|was| row.ratio < (1.0 - SLOWER) * was);
            marked += usize::from(fell);
            let (was, mark) = (was.map_or_else(String::new, |was| format!("{was:.2}")), if fell { " <" } else { "" });
            let errors = row.errors.map(|[a, b]| format!("{a:>20.1e}{b:>20.1e}")).unwrap_or_default();
            println!("  {:<46}{:>10.3}{:>9.2}{was:>9}{errors}{mark}", row.name, row.micros, row.ratio);
        }
        marked
    }
}

/// Measures the group of a scene: a row for one environment in `f64`, and a row for each lane type and CPU level.
fn steps(scene: &Scene, rounds: usize) -> Group {
    let mut alone = single(scene);
    let (mut names, mut batches) = (vec!["f64".to_owned()], vec![]);
    for &level in Level::available() {
        for (lane, precision) in [("f64 lanes", Precision::F64), ("f32 lanes", Precision::F32)] {
            names.push(format!("{lane} {level}"));
            batches.push(lanes(scene, precision, level));
        }
    }
    let mut runs: Vec<&mut dyn Run> = vec![&mut alone];
    runs.extend(batches.iter_mut().map(|b| b as &mut dyn Run));
    let times = medians(&mut runs, rounds);
    Group::new(scene.name.into(), None, names.into_iter().zip(times).map(|(name, t)| (name, t, None)).collect())
}

/// Measures the group of a scene of the comparison with rapier: a row for each engine and setting.
fn peers(course: Course, rounds: usize) -> Group {
    let mut entries = entries(course);
    let mut runs: Vec<&mut dyn Run> = entries.iter_mut().map(|e| &mut *e.engine as &mut dyn Run).collect();
    let times = medians(&mut runs, rounds);
    let rows = entries.into_iter().zip(times).map(|(e, t)| (e.name, t, Some(e.errors))).collect();
    let name = format!("{}, dt {} s, beside rapier", course.name(), course.timestep());
    Group::new(name, Some(course.measures().map(Into::into)), rows)
}

/// Exit code of a program that ends with `result`. The function prints an error to standard error.
pub fn exit_code(result: Result<ExitCode, String>) -> ExitCode {
    result.unwrap_or_else(|message| {
        eprintln!("{message}");
        ExitCode::FAILURE
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ratios_are_against_the_first_row_and_survive_a_file() {
        let group = Group::new("scene".into(), None, vec![("slow".into(), 3.0, None), ("fast".into(), 1.5, Some([1e-3, 0.0]))]);
        assert_eq!((group.rows[0].ratio, group.rows[1].ratio), (1.0, 2.0));
        let report = Report { machine: Machine::this(1), steps: vec![group], peers: vec![] };
        let path = std::env::temp_dir().join(format!("stepper-ratios-{}.json", std::process::id()));
        report.save(&path).unwrap();
        let mut back = Report::load(&path).unwrap();
        std::fs::remove_file(&path).unwrap();
        assert_eq!(back.group("scene").unwrap().rows[1].errors, Some([1e-3, 0.0]));
        back.comparable().unwrap();
        back.machine.levels = vec!["of another machine".into()];
        assert!(back.comparable().unwrap_err().contains("of another machine"));
    }

    #[test]
    fn ratios_that_fell_are_marked() {
        let group = |fast: f64| Group::new("scene".into(), None, vec![("slow".into(), 3.0, None), ("fast".into(), fast, None)]);
        assert_eq!([1.5, 1.6, 1.7].map(|fast| group(fast).print(Some(&group(1.5)))), [0, 0, 1]);
    }
}

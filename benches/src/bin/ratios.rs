//! Ratios of simulation speeds, measured in one run on one core, with the ratios of `benches/baseline.json` for comparison.

use std::path::PathBuf;
use std::process::ExitCode;

use stepper_benches::clock::pin;
use stepper_benches::report::{Report, exit_code};

const USAGE: &str = "usage: ratios [--rounds N] [--save [FILE]] [--against FILE]

Prints microseconds per environment step, and the speed of every row relative to the first row of its group.
  --rounds N       number of repetitions, of which the medians are printed (default 11)
  --save [FILE]    also writes the report as JSON (default benches/baseline.json)
  --against FILE   also prints the ratios of this report (default benches/baseline.json, if it exists). A report of other CPU levels
                   is an error; the default report is then ignored
Ratios that fell by more than 10 % are marked with \"<\".";

fn main() -> ExitCode {
    exit_code(run().map(|()| ExitCode::SUCCESS))
}

fn run() -> Result<(), String> {
    let baseline = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("baseline.json");
    let (mut rounds, mut save, mut against) = (11, None, None);
    let mut words = std::env::args().skip(1).peekable();
    while let Some(word) = words.next() {
        match word.as_str() {
            "--rounds" => rounds = words.next().and_then(|n| n.parse().ok()).filter(|&n| n > 0).ok_or(USAGE)?,
            "--save" => save = Some(words.next_if(|w| !w.starts_with("--")).map_or_else(|| baseline.clone(), PathBuf::from)),
            "--against" => against = Some(PathBuf::from(words.next().ok_or(USAGE)?)),
            _ => return Err(USAGE.into()),
        }
    }
    let before = match against {
        Some(path) => {
            let before = Report::load(&path).map_err(|e| format!("{}: {e}", path.display()))?;
            before.comparable().map_err(|e| format!("{}: {e}", path.display()))?;
            Some(before)
        }
        // The default file is ignored with a message if it is not comparable. A file that the user names is an error in this case.
        None => Report::load(&baseline).ok().filter(|before| match before.comparable() {
            Ok(()) => true,
            Err(why) => {
                println!("not compared with {}: {why}", baseline.display());
                false
            }
        }),
    };
    if pin().is_none() {
        eprintln!("not pinned to a core: pin this process yourself, for example with `taskset -c 0`");
    }
    let report = Report::measure(rounds);
    report.print(before.as_ref());
    if let Some(path) = save {
        report.save(&path).map_err(|e| format!("{}: {e}", path.display()))?;
        println!("\nsaved to {}", path.display());
    }
    Ok(())
}

//! Time of a whole step of robots in contact: one environment in `f64`, and 64 in SIMD lanes on every CPU level. Also derivatives of the
//! ant's step. Times are per environment step.

use criterion::{Criterion, SamplingMode, Throughput, criterion_group, criterion_main};
use std::time::Duration;
use stepper_benches::clock::{Run, pin};
use stepper_benches::derivative::Derivatives;
use stepper_benches::episode::{lanes, single};
use stepper_benches::scenes::Scene;
use stepper_core::{Level, Precision};

/// Number of environments for which derivatives are timed in SIMD lanes.
const LANES: usize = 16;

fn steps(c: &mut Criterion) {
    pin();
    for scene in Scene::all() {
        bench(c, scene.name, "f64", || single(&scene));
        for &level in Level::available() {
            bench(c, scene.name, &format!("f64 lanes {level}"), || lanes(&scene, Precision::F64, level));
            bench(c, scene.name, &format!("f32 lanes {level}"), || lanes(&scene, Precision::F32, level));
        }
    }
    let (ant, best) = (Scene::ant(), *Level::available().last().expect("the baseline is always available"));
    bench(c, "ant derivative", "f64", || Derivatives::new(&ant, 1, best));
    for &level in Level::available() {
        bench(c, "ant derivative", &format!("f64 lanes {level}"), || Derivatives::new(&ant, LANES, level));
    }
}

/// Adds the benchmark of one run. `make` creates the run when the benchmark starts, and the throughput is in environment steps.
fn bench<T: Run>(c: &mut Criterion, scene: &str, name: &str, make: impl Fn() -> T) {
    let mut run = None;
    let mut group = c.benchmark_group(scene);
    group.sample_size(10).sampling_mode(SamplingMode::Flat).warm_up_time(Duration::from_millis(200));
    group.measurement_time(Duration::from_secs(1));
    // Environment steps of a run: 100 steps of 8 or of 64 environments, or one derivative per environment.
    group.throughput(Throughput::Elements(match (scene, name) {
        ("ant derivative", "f64") => 1,
        ("ant derivative", _) => LANES as u64,
        (_, "f64") => 800,
        _ => 6400,
    }));
    group.bench_function(name, |b| {
        let run = run.get_or_insert_with(&make);
        b.iter_custom(|times| run.time(times));
    });
}

criterion_group!(benches, steps);
criterion_main!(benches);

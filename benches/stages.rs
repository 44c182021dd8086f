//! Times of the parts of a humanoid's step, measured within whole steps, per environment step. The benchmark measures one environment in
//! `f64`, and a full SIMD group of environments at the best CPU level.

use criterion::{Criterion, SamplingMode, Throughput, criterion_group, criterion_main};
use std::time::Duration;
use stepper_benches::clock::{Run, pin};
use stepper_benches::episode::{Episode, InTurn, single};
use stepper_benches::recorder::{Recording, nanoseconds, own_cost};
use stepper_benches::scenes::Scene;
use stepper_core::{Level, Precision};

fn stages(c: &mut Criterion) {
    pin();
    let level = Level::best().expect("STEPPER_CPU_LEVEL names a level of this machine");
    let scene = Scene::humanoid();
    parts(c, "humanoid stages f64", || single(&scene));
    let lanes = if level == Level::Avx512 { 16 } else { 8 };
    let episode = || InTurn(vec![Episode::new(&scene, 0, lanes, Precision::F64, level)]);
    parts(c, &format!("humanoid stages f64 lanes {level}"), episode);
}

/// Adds a benchmark for each part of the step, and one for the whole step. `make` creates the benchmark run.
fn parts(c: &mut Criterion, name: &str, make: impl Fn() -> InTurn<Episode>) {
    let own = own_cost();
    let mut probed = make().probe();
    let mut time = |times: u64| {
        let mut sum = Recording::default();
        (0..times).for_each(|_| sum.add(&probed.record(nanoseconds, 1), 1.0));
        sum.subtract_probe(own);
        sum
    };
    let found = time(1);
    let mut whole = make();
    let mut group = c.benchmark_group(name);
    group.sample_size(10).sampling_mode(SamplingMode::Flat).warm_up_time(Duration::from_millis(100));
    group.measurement_time(Duration::from_millis(400));
    for (k, (part, _)) in found.rows().enumerate().filter(|(_, (_, row))| row.readings[0] > 0.0) {
        // The recording is per environment step.
        group.throughput(Throughput::Elements(1));
        let time = &mut time;
        group.bench_function(part, |b| {
            b.iter_custom(|times| {
                let row = time(times).rows().nth(k).expect("as many as there were").1;
                Duration::from_secs_f64(1e-9 * row.readings[0].max(1e-3))
            });
        });
    }
    group.throughput(Throughput::Elements(whole.environment_steps()));
    group.bench_function("whole step", |b| b.iter_custom(|times| whole.time(times)));
}

criterion_group!(benches, stages);
criterion_main!(benches);

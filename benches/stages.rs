//! The stages of a humanoid's step, one at a time: one environment in `f64`, and as many as the best CPU level has lanes for. Times are per
//! environment, averaged over moments of an episode. The whole step beside them calls some stages twice, and loads and stores its state.

use criterion::{Criterion, SamplingMode, Throughput, criterion_group, criterion_main};
use std::time::Duration;
use stepper_benches::clock::{Run, pin, thread_time};
use stepper_benches::episode::{Episode, single};
use stepper_benches::rig::{Part, Rig, moments};
use stepper_benches::scenes::Scene;
use stepper_core::internals::compile::{CompiledModel, LaneModel};
use stepper_core::{Level, Precision};
use stepper_real::{Real, at_avx512, at_level};

/// Moments that are averaged over.
const MOMENTS: usize = 8;

fn stages(c: &mut Criterion) {
    pin();
    let level = Level::best().expect("STEPPER_CPU_LEVEL names a level of this machine");
    let name = format!("humanoid stages f64 lanes {level}");
    let scene = Scene::humanoid();
    let alone = || single(&scene);
    at_level!(level, F64x1, parts::<_, _>(c, "humanoid stages f64", &scene, alone));
    let lanes = |n: usize| {
        let scene = &scene;
        move || Episode::new(scene, 0, n, Precision::F64, level)
    };
    match level {
        Level::Avx512 => at_avx512!(F64x16, parts::<_, _>(c, &name, &scene, lanes(16))),
        _ => at_level!(level, F64x8, parts::<_, _>(c, &name, &scene, lanes(8))),
    }
}

fn parts<R: Real<Scalar = f64>, T: Run>(c: &mut Criterion, name: &str, scene: &Scene, whole: impl Fn() -> T) {
    let compiled = LaneModel::new(&CompiledModel::new(&scene.model));
    let mut rigs: Option<Vec<Rig<R>>> = None;
    let mut run = None;
    let mut group = c.benchmark_group(name);
    group.sample_size(10).sampling_mode(SamplingMode::Flat).warm_up_time(Duration::from_millis(100));
    group.measurement_time(Duration::from_millis(400)).throughput(Throughput::Elements((MOMENTS * R::LANES) as u64));
    for part in Part::ALL {
        group.bench_function(part.name(), |b| {
            let rigs = rigs.get_or_insert_with(|| moments(&compiled, scene, MOMENTS));
            b.iter_custom(|times| rigs.iter_mut().map(|rig| repeated(rig, &compiled, part, times)).sum());
        });
    }
    // A hundred steps of the group, or of eight environments one after the other.
    group.throughput(Throughput::Elements(100 * R::LANES.max(8) as u64));
    group.bench_function("whole step", |b| {
        let run = run.get_or_insert_with(&whole);
        b.iter_custom(|times| run.time(times));
    });
}

fn repeated<R: Real<Scalar = f64>>(rig: &mut Rig<R>, compiled: &LaneModel<R>, part: Part, times: u64) -> Duration {
    rig.ready(compiled);
    // Once to warm the caches.
    rig.repeat(compiled, part, 1);
    let start = thread_time();
    rig.repeat(compiled, part, times);
    thread_time() - start
}

criterion_group!(benches, stages);
criterion_main!(benches);

//! The stages of a humanoid's step, one at a time: one environment in `f64`, and eight in the lanes of the best CPU level. Times are per
//! environment, averaged over moments of an episode.

use criterion::{Criterion, SamplingMode, Throughput, criterion_group, criterion_main};
use std::time::Duration;
use stepper_benches::clock::{pin, thread_time};
use stepper_benches::rig::{Part, Rig, moments};
use stepper_benches::scenes::Scene;
use stepper_core::Level;
use stepper_core::plan::Plan;
use stepper_real::Real;

/// Moments that are averaged over: eight environments in either case.
const MOMENTS: usize = 8;

fn stages(c: &mut Criterion) {
    pin();
    parts::<f64>(c, "humanoid stages f64", 2 * MOMENTS);
    match Level::best().expect("STEPPER_CPU_LEVEL names a level of this machine") {
        #[cfg(target_arch = "x86_64")]
        Level::Avx512 => parts::<stepper_real::avx512::F64x8>(c, "humanoid stages F64x8 avx512", MOMENTS),
        #[cfg(target_arch = "x86_64")]
        Level::Avx2 => parts::<stepper_real::avx2::F64x8>(c, "humanoid stages F64x8 avx2", MOMENTS),
        _ => parts::<stepper_real::array::F64x8>(c, "humanoid stages F64x8 baseline", MOMENTS),
    }
}

fn parts<R: Real<Scalar = f64>>(c: &mut Criterion, name: &str, count: usize) {
    let scene = Scene::humanoid();
    let plan = Plan::new(&scene.model);
    let mut rigs: Option<Vec<Rig<R>>> = None;
    let mut group = c.benchmark_group(name);
    group.sample_size(10).sampling_mode(SamplingMode::Flat).warm_up_time(Duration::from_millis(100));
    group.measurement_time(Duration::from_millis(500)).throughput(Throughput::Elements((count * R::LANES) as u64));
    for part in Part::STEP.into_iter().chain(Part::CLOSER) {
        group.bench_function(part.name(), |b| {
            let rigs = rigs.get_or_insert_with(|| moments(&plan, &scene, count));
            b.iter_custom(|times| {
                let mut total = Duration::ZERO;
                for rig in rigs.iter_mut() {
                    // One more than what is timed warms the caches.
                    rig.repeat(&plan, part, 1);
                    let start = thread_time();
                    rig.repeat(&plan, part, times);
                    total += thread_time() - start;
                }
                total
            });
        });
    }
}

criterion_group!(benches, stages);
criterion_main!(benches);

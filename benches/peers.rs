//! Speed of stepper and of rapier on the same scenes. The error with each setting is printed first. Times are per environment step.

use criterion::{Criterion, SamplingMode, Throughput, criterion_group, criterion_main};
use std::time::Duration;
use stepper_benches::clock::pin;
use stepper_benches::peers::{Course, entries};

fn peers(c: &mut Criterion) {
    pin();
    for course in Course::ALL {
        let [first, second] = course.measures();
        println!("\n{}: dt {} s, {} s; right answer: {}", course.name(), course.timestep(), course.duration(), course.reference());
        println!("  {:<48}{first:>18}{second:>18}", "");
        let mut entries = entries(course);
        for entry in &entries {
            println!("  {:<48}{:>18.1e}{:>18.1e}", entry.name, entry.errors[0], entry.errors[1]);
        }
        let mut group = c.benchmark_group(course.name());
        group.sample_size(10).sampling_mode(SamplingMode::Flat).warm_up_time(Duration::from_millis(100));
        group.measurement_time(Duration::from_millis(500));
        for entry in &mut entries {
            group.throughput(Throughput::Elements(entry.engine.environment_steps()));
            group.bench_function(&entry.name, |b| b.iter_custom(|times| entry.engine.time(times)));
        }
    }
}

criterion_group!(benches, peers);
criterion_main!(benches);

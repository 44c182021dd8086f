//! `STEPPER_ONE_LEVEL=avx512` (or `avx2`, `baseline`) builds the kernels of that CPU level only, in less than half the time. `native` is
//! the fastest level of the machine that builds.

const LEVELS: [&str; 3] = ["avx512", "avx2", "baseline"];

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rerun-if-env-changed=STEPPER_ONE_LEVEL");
    println!("cargo::rustc-check-cfg=cfg(one_level, values(\"avx512\", \"avx2\", \"baseline\"))");
    let level = std::env::var("STEPPER_ONE_LEVEL").unwrap_or_default();
    let level = if level == "native" { native() } else { &level };
    if !level.is_empty() {
        assert!(LEVELS.contains(&level), "STEPPER_ONE_LEVEL is {level}: expected avx512, avx2, baseline or native");
        println!("cargo::rustc-cfg=one_level=\"{level}\"");
    }
}

/// Fastest CPU level of the machine that builds. The text is empty if the build is for another target, which gets all of its levels.
#[cfg(target_arch = "x86_64")]
fn native() -> &'static str {
    if std::env::var("TARGET") != std::env::var("HOST") {
        return "";
    }
    // These are the features of `Level::detect`.
    if is_x86_feature_detected!("avx512f") && is_x86_feature_detected!("avx512dq") && is_x86_feature_detected!("avx512vl") {
        "avx512"
    } else if is_x86_feature_detected!("avx2") {
        "avx2"
    } else {
        "baseline"
    }
}

/// Empty text, which selects all levels: other architectures have a single level.
#[cfg(not(target_arch = "x86_64"))]
fn native() -> &'static str {
    ""
}

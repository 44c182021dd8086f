//! `STEPPER_ONE_LEVEL=avx512` (or `avx2`, `baseline`) builds the kernels of that CPU level only, in less than half the time. `native` is
//! the fastest level of the machine that builds.

const LEVELS: [&str; 3] = ["avx512", "avx2", "baseline"];

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rerun-if-env-changed=STEPPER_ONE_LEVEL");
    println!("cargo::rustc-check-cfg=cfg(has_level, values(\"avx512\", \"avx2\", \"baseline\"))");
    let level = std::env::var("STEPPER_ONE_LEVEL").unwrap_or_default();
    let level = if level == "native" { native() } else { &level };
    assert!(level.is_empty() || LEVELS.contains(&level), "STEPPER_ONE_LEVEL is {level}: expected avx512, avx2, baseline or native");
    let is_x86_64 = std::env::var("CARGO_CFG_TARGET_ARCH").is_ok_and(|name| name == "x86_64");
    let has_feature = |name: &str| is_x86_64 && std::env::var_os(format!("CARGO_FEATURE_{}", name.to_uppercase())).is_some();
    for name in LEVELS {
        if (level.is_empty() || level == name) && (name == "baseline" || has_feature(name)) {
            println!("cargo::rustc-cfg=has_level=\"{name}\"");
        }
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

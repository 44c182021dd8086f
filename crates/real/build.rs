//! `STEPPER_ONE_LEVEL=avx512` (or `avx2`, `baseline`) builds the kernels of that CPU level only: a development build in less than half the
//! time.

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rerun-if-env-changed=STEPPER_ONE_LEVEL");
    println!("cargo::rustc-check-cfg=cfg(one_level, values(\"avx512\", \"avx2\", \"baseline\"))");
    if let Ok(level) = std::env::var("STEPPER_ONE_LEVEL")
        && !level.is_empty()
    {
        assert!(
            ["avx512", "avx2", "baseline"].contains(&level.as_str()),
            "STEPPER_ONE_LEVEL is {level}: expected avx512, avx2 or baseline"
        );
        println!("cargo::rustc-cfg=one_level=\"{level}\"");
    }
}

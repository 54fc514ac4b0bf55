//! Loops with the widest vectors that the processor has.
//!
//! A kernel is plain Rust: it is compiled for each level of x86-64 (and once for everything else), and the best one is
//! taken at run time. All of them compute the same bits: Rust never fuses or reorders floating-point operations.

use pulp::{Arch, NullaryFnOnce};

/// Runs a kernel, whose `call` must be `#[inline(always)]`: otherwise it is compiled for the baseline only.
#[cfg(not(test))]
pub(crate) fn widest<K: NullaryFnOnce>(kernel: K) -> K::Output {
    Arch::new().dispatch(kernel)
}

/// As in other builds, unless `DESCRY_VECTORS` names a lower level: "baseline" or "v3". All levels must pass the tests,
/// and one machine has to be able to run them.
#[cfg(test)]
pub(crate) fn widest<K: NullaryFnOnce>(kernel: K) -> K::Output {
    static LEVEL: std::sync::OnceLock<String> = std::sync::OnceLock::new();
    let level = LEVEL.get_or_init(|| std::env::var("DESCRY_VECTORS").unwrap_or_default());
    match level.as_str() {
        "baseline" => kernel.call(),
        #[cfg(target_arch = "x86_64")]
        "v3" => pulp::x86::V3::try_new().expect("a processor of level x86-64-v3").vectorize(kernel),
        "" => Arch::new().dispatch(kernel),
        other => panic!("DESCRY_VECTORS: must be baseline or v3, got {other}"),
    }
}

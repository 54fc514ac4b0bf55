//! Runs a kernel with the vectors that the programs run theirs with.

use std::sync::OnceLock;

use pulp::{Arch, NullaryFnOnce};

/// Vectors that kernels are run with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Level {
    Baseline,
    V3,
    Widest,
}

/// By `DESCRY_VECTORS`, as in crate `descriptor`: "baseline", "v3", or, without it, the widest that there are.
fn level() -> Level {
    static LEVEL: OnceLock<Level> = OnceLock::new();
    *LEVEL.get_or_init(|| match std::env::var("DESCRY_VECTORS").unwrap_or_default().as_str() {
        "" => Level::Widest,
        "baseline" => Level::Baseline,
        "v3" => Level::V3,
        other => panic!("DESCRY_VECTORS: must be baseline or v3, got {other}"),
    })
}

/// Runs a kernel, whose `call` must be `#[inline(always)]`: otherwise it is compiled for the baseline only.
pub fn widest<K: NullaryFnOnce>(kernel: K) -> K::Output {
    match level() {
        Level::Baseline => kernel.call(),
        #[cfg(target_arch = "x86_64")]
        Level::V3 => pulp::x86::V3::try_new().expect("a processor of level x86-64-v3").vectorize(kernel),
        _ => Arch::new().dispatch(kernel),
    }
}

/// The vectors by name.
pub fn name() -> &'static str {
    #[cfg(target_arch = "x86_64")]
    if level() != Level::Baseline {
        if level() == Level::Widest && pulp::x86::V4::try_new().is_some() {
            return "AVX-512 (x86-64-v4)";
        }
        if pulp::x86::V3::try_new().is_some() {
            return "AVX2 (x86-64-v3)";
        }
    }
    "those of the baseline"
}

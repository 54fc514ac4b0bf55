//! Loops with the widest vectors that the processor has.
//!
//! A kernel is plain Rust: it is compiled for each level of x86-64 (and once for everything else), and the best one is
//! taken at run time. All of them compute the same bits: Rust never fuses or reorders floating-point operations.
//!
//! The environment variable `DESCRY_VECTORS` asks for a lower level, so that one machine can test and measure all of them:
//! "v3" for AVX2 where there is AVX-512, "baseline" for what every processor of the target has (SSE2 on x86-64).

use std::sync::OnceLock;

use pulp::{Arch, NullaryFnOnce, WithSimd};

/// What kernels run with.
#[derive(Clone, Copy, Debug)]
enum Level {
    Widest(Arch),
    #[cfg(target_arch = "x86_64")]
    V3(pulp::x86::V3),
    Baseline,
}

/// `DESCRY_VECTORS` asks for what this processor does not have, or for something unknown.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "DESCRY_VECTORS: baseline, or v3 on a processor with AVX2, expected, got {0}\nleave it out for the widest vectors"
)]
pub struct VectorsError(String);

/// Checks what `DESCRY_VECTORS` asks for. Programs call it when they start: kernels take a mistake in it for nothing.
///
/// # Errors
/// If this processor cannot do that.
pub fn check_environment() -> Result<(), VectorsError> {
    Level::of_environment().map(|_| ())
}

impl Level {
    fn of_environment() -> Result<Self, VectorsError> {
        let asked = std::env::var_os("DESCRY_VECTORS").unwrap_or_default();
        let level = match asked.to_str() {
            Some("") => Some(Self::Widest(Arch::new())),
            Some("baseline") => Some(Self::Baseline),
            #[cfg(target_arch = "x86_64")]
            Some("v3") => pulp::x86::V3::try_new().map(Self::V3),
            _ => None,
        };
        level.ok_or_else(|| VectorsError(asked.to_string_lossy().into_owned()))
    }
}

/// That of this process.
fn level() -> Level {
    static LEVEL: OnceLock<Level> = OnceLock::new();
    *LEVEL.get_or_init(|| Level::of_environment().unwrap_or(Level::Widest(Arch::new())))
}

/// Runs a kernel, whose `call` must be `#[inline(always)]`: otherwise it is compiled for the baseline only.
pub fn widest<K: NullaryFnOnce>(kernel: K) -> K::Output {
    match level() {
        Level::Widest(arch) => arch.dispatch(kernel),
        #[cfg(target_arch = "x86_64")]
        Level::V3(vectors) => vectors.vectorize(kernel),
        Level::Baseline => kernel.call(),
    }
}

/// Runs a kernel that computes with vectors of its own, of 16 floats on x86-64. `with_simd` must be `#[inline(always)]`.
pub(crate) fn with_widest<K: WithSimd>(kernel: K) -> K::Output {
    match level() {
        #[cfg(target_arch = "x86_64")]
        Level::Widest(Arch::V4(simd)) => simd.vectorize(With { kernel, simd }),
        #[cfg(target_arch = "x86_64")]
        Level::Widest(Arch::V3(vectors)) | Level::V3(vectors) => {
            vectors.vectorize(With { kernel, simd: pulp::x86::V3_512b(vectors) })
        }
        #[cfg(not(target_arch = "x86_64"))]
        Level::Widest(arch) => arch.dispatch(kernel),
        _ => kernel.with_simd(pulp::Scalar512b),
    }
}

/// A kernel with the vectors that it computes with.
#[cfg(target_arch = "x86_64")]
struct With<K, S> {
    kernel: K,
    simd: S,
}

#[cfg(target_arch = "x86_64")]
impl<K: WithSimd, S: pulp::Simd> NullaryFnOnce for With<K, S> {
    type Output = K::Output;

    #[inline(always)]
    fn call(self) -> K::Output {
        self.kernel.with_simd(self.simd)
    }
}

/// What people call the vectors that kernels run with.
pub fn name() -> &'static str {
    match level() {
        #[cfg(target_arch = "x86_64")]
        Level::Widest(Arch::V4(_)) => "AVX-512 (x86-64-v4)",
        #[cfg(target_arch = "x86_64")]
        Level::Widest(Arch::V3(_)) | Level::V3(_) => "AVX2 (x86-64-v3)",
        _ => "those of the baseline",
    }
}

#[cfg(test)]
mod tests {
    /// A mistake in it would have every other test run with the widest vectors.
    #[test]
    fn tests_run_with_the_vectors_that_the_environment_asks_for() {
        super::check_environment().unwrap();
    }
}

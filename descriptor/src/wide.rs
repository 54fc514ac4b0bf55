//! Loops with the widest vectors that the processor has.
//!
//! A kernel is plain Rust, or computes with vectors that it is given: it is compiled for each level of x86-64 (and once for
//! everything else), and the best one is taken at run time. All of them compute the same bits: Rust never fuses or reorders
//! floating-point operations.
//!
//! The environment variable `DESCRY_VECTORS` asks for a lower level, so that one machine can test and measure all of them:
//! "v3" for AVX2 where there is AVX-512, "baseline" for what every processor of the target has (SSE2 on x86-64).

use std::sync::OnceLock;

#[cfg(target_arch = "x86_64")]
use pulp::Simd;
use pulp::{Arch, WithSimd};

/// What kernels run with.
#[derive(Clone, Copy, Debug)]
enum Level {
    #[cfg_attr(not(target_arch = "x86_64"), expect(dead_code, reason = "there is one level"))]
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

/// Runs a kernel, whose `call` or `with_simd` must be `#[inline(always)]`: otherwise it is compiled for the baseline only.
/// Vectors that it is given have 16 floats, whatever the level.
pub fn widest<K: WithSimd>(kernel: K) -> K::Output {
    match level() {
        #[cfg(target_arch = "x86_64")]
        Level::Widest(Arch::V4(vectors)) => Simd::vectorize(vectors, kernel),
        #[cfg(target_arch = "x86_64")]
        Level::Widest(Arch::V3(vectors)) | Level::V3(vectors) => {
            vectors.vectorize(InPairs { kernel, vectors })
        }
        _ => kernel.with_simd(pulp::Scalar512b),
    }
}

/// A kernel with the vectors of AVX2, two at a time.
#[cfg(target_arch = "x86_64")]
struct InPairs<K> {
    kernel: K,
    vectors: pulp::x86::V3,
}

#[cfg(target_arch = "x86_64")]
impl<K: WithSimd> pulp::NullaryFnOnce for InPairs<K> {
    type Output = K::Output;

    #[inline(always)]
    fn call(self) -> K::Output {
        self.kernel.with_simd(pulp::x86::V3_512b(self.vectors))
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

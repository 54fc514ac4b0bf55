//! The `coordinator` program.

use std::process::ExitCode;

use tikv_jemallocator::Jemalloc;

/// Keeps the memory of a long run small: glibc has arenas for many threads, and holds on to what was freed in one while
/// another grows.
#[global_allocator]
static ALLOCATOR: Jemalloc = Jemalloc;

fn main() -> ExitCode {
    coordinator::cli::main(worker::commit!())
}

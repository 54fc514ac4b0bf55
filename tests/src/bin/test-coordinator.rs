//! The coordinator as the tests have just built it.

use tikv_jemallocator::Jemalloc;

#[global_allocator]
static ALLOCATOR: Jemalloc = Jemalloc;

fn main() -> std::process::ExitCode {
    coordinator::cli::main(worker::version::NO_COMMIT)
}

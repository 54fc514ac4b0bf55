//! The worker as the tests have just built it.

fn main() -> std::process::ExitCode {
    worker::cli::main(worker::version::NO_COMMIT)
}

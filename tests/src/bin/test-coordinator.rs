//! The coordinator as the tests have just built it.

fn main() -> std::process::ExitCode {
    coordinator::cli::main(worker::version::NO_COMMIT)
}

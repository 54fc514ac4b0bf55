//! The `worker` program.

use std::process::ExitCode;

fn main() -> ExitCode {
    worker::cli::main(worker::commit!())
}

#[cfg(test)]
mod tests {
    use std::path::Path;
    use std::process::Command;

    /// Outside a repository there is nothing to compare with.
    #[test]
    fn the_commit_is_the_one_that_git_names() {
        let repository = concat!(env!("CARGO_MANIFEST_DIR"), "/..");
        if !Path::new(repository).join(".git").exists() || option_env!("DESCRY_COMMIT").is_some() {
            return;
        }
        let git = Command::new("git").args(["-C", repository, "rev-parse", "HEAD"]).output().unwrap();
        let commit = String::from_utf8(git.stdout).unwrap();
        assert!(commit.starts_with(worker::commit!()), "{} {commit}", worker::commit!());
    }
}

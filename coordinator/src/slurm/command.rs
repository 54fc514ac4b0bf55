//! Commands of Slurm. They may hang while its controller is down: each is given up after a while, and when nobody waits for
//! it any more.

use std::future::Future;
use std::io;
use std::process::{Output, Stdio};
use std::thread;
use std::time::Duration;

use tokio::process::Command;
use tokio::runtime::{Builder, Runtime};

/// How long a command may take. Slurm's own wait for its controller is 10 s (`MessageTimeout`), some times over.
pub const PATIENCE: Duration = Duration::from_secs(60);

/// What a command has printed and how it has ended. Dropped before that, it is killed.
///
/// # Errors
/// If it cannot be started; [`io::ErrorKind::TimedOut`] if it has not ended by then.
pub async fn output(command: &mut Command, patience: Duration) -> io::Result<Output> {
    command.stdin(Stdio::null()).kill_on_drop(true);
    tokio::time::timeout(patience, command.output()).await.unwrap_or_else(|_| {
        let what = format!("no answer within {} s", patience.as_secs_f64());
        Err(io::Error::new(io::ErrorKind::TimedOut, what))
    })
}

/// A runtime of one thread: that on which it is used.
pub fn runtime() -> io::Result<Runtime> {
    Builder::new_current_thread().enable_all().build()
}

/// Waits for commands on a thread of its own, whatever thread this is.
pub fn wait<T: Send>(work: impl Future<Output = io::Result<T>> + Send) -> io::Result<T> {
    let on_its_own = || runtime()?.block_on(work);
    thread::scope(|scope| scope.spawn(on_its_own).join())
        .unwrap_or_else(|panic| std::panic::resume_unwind(panic))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_command_that_hangs_is_given_up_and_others_say_what_they_say() {
        let sh = |script: &str| {
            let mut command = Command::new("sh");
            command.args(["-c", script]);
            command
        };
        let hangs = wait(output(&mut sh("exec sleep 600"), Duration::from_millis(100))).unwrap_err();
        assert_eq!((hangs.kind(), &*hangs.to_string()), (io::ErrorKind::TimedOut, "no answer within 0.1 s"));
        let done = wait(output(&mut sh("echo 7; exit 3"), PATIENCE)).unwrap();
        assert_eq!((done.status.code(), &*done.stdout), (Some(3), &b"7\n"[..]));
        let nowhere = wait(output(&mut Command::new("/no/such/program"), PATIENCE)).unwrap_err();
        assert_eq!(nowhere.kind(), io::ErrorKind::NotFound);
    }
}

//! The harness: starts programs, waits for states, shows every log when something fails.

use std::ffi::OsStr;
use std::fs::{self, File};
use std::io::Read as _;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Output, Stdio};
use std::sync::OnceLock;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::{Duration, Instant};
use std::{env, thread};

use rustix::io::Errno;
use rustix::pipe::{self, PipeFlags, SpliceFlags};
use tempfile::TempDir;

/// Longer than anything here takes on a slow machine; a test that runs into it has failed.
pub const PATIENCE: Duration = Duration::from_secs(120);
/// How often a state is looked at.
const GLANCE: Duration = Duration::from_millis(20);

/// A program of this workspace, as cargo has just built it for the tests or benchmarks that this is.
pub fn program(name: &str) -> Command {
    let this = env::current_exe().unwrap(); // <target>/<profile>/deps/<name>
    let path = this.ancestors().nth(2).unwrap().join(format!("test-{name}{}", env::consts::EXE_SUFFIX));
    assert!(path.is_file(), "no program {name}: {}", path.display());
    let mut command = Command::new(path);
    for variable in [
        "DESCRY_COORDINATOR",
        "DESCRY_LOG",
        "DESCRY_CACHE",
        "DESCRY_CACHE_SIZE",
        "DESCRY_MEMORY",
        "DESCRY_SHARED_CACHE",
    ] {
        command.env_remove(variable);
    }
    command.env("XDG_CACHE_HOME", unused_cache()).stdin(Stdio::null());
    command
}

/// Where programs have a cache each.
fn caches() -> &'static Path {
    static CACHES: OnceLock<TempDir> = OnceLock::new();
    CACHES.get_or_init(|| TempDir::new().unwrap()).path()
}

/// A cache for one program: what tests want to be remembered, they keep in a cache that they name with `--cache`.
fn unused_cache() -> PathBuf {
    static USED: AtomicU32 = AtomicU32::new(0);
    caches().join(USED.fetch_add(1, Ordering::Relaxed).to_string())
}

/// The cache that [`program`] has given a program, removed with this: all tests together would leave gigabytes.
struct OwnCache(Option<PathBuf>);

impl OwnCache {
    fn of(command: &Command) -> Self {
        let set = command.get_envs().find(|(name, _)| *name == "XDG_CACHE_HOME");
        let path = set.and_then(|(_, value)| value).map(PathBuf::from);
        Self(path.filter(|path| path.starts_with(caches())))
    }
}

impl Drop for OwnCache {
    fn drop(&mut self) {
        if let Some(path) = &self.0 {
            let _ = fs::remove_dir_all(path); // a program that kept nothing has made none
        }
    }
}

/// A program that was run to its end.
pub struct Finished {
    command: String,
    /// Its exit status.
    pub status: ExitStatus,
    /// Its standard output.
    pub stdout: String,
    /// Its standard error.
    pub stderr: String,
}

impl Finished {
    /// Fails the test with everything there is to see, unless the program succeeded.
    #[track_caller]
    pub fn expect_success(self) -> Self {
        assert!(self.status.success(), "{self}");
        self
    }

    /// Fails the test unless the program failed as programs should: with an error message, not a panic.
    #[track_caller]
    pub fn expect_error(self) -> Self {
        assert!(!self.status.success(), "{self}");
        assert!(self.status.code().is_some_and(|code| code != 101), "{self}");
        assert!(!self.stderr.contains("panicked"), "{self}");
        self
    }
}

impl std::fmt::Display for Finished {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { command, status, stdout, stderr } = self;
        write!(f, "{command}\n{status}\n--- stdout\n{stdout}\n--- stderr\n{stderr}")
    }
}

/// Runs a program to its end.
pub fn run<A: AsRef<OsStr>>(name: &str, args: impl IntoIterator<Item = A>) -> Finished {
    let mut command = program(name);
    command.args(args);
    finish(&mut command)
}

/// Runs a prepared program to its end.
pub fn finish(command: &mut Command) -> Finished {
    let _cache = OwnCache::of(command);
    let Output { status, stdout, stderr } = command.output().unwrap();
    Finished {
        command: format!("{command:?}"),
        status,
        stdout: String::from_utf8_lossy(&stdout).into_owned(),
        stderr: String::from_utf8_lossy(&stderr).into_owned(),
    }
}

/// Runs a program until a line of its log contains `text`, and kills it there, however fast it is and however seldom this
/// test gets a processor: its log, in which every job is a line, goes into a pipe that holds one. The line is looked at
/// before it is taken out, so that the program can do what comes before the next line, and no more.
#[track_caller]
pub fn kill_at<A: AsRef<OsStr>>(name: &str, args: impl IntoIterator<Item = A>, text: &str) -> Finished {
    const PAGE: usize = 4096; // the smallest pipe there is; of packets it holds one
    let packets = || pipe::pipe_with(PipeFlags::CLOEXEC | PipeFlags::DIRECT).unwrap();
    let ((log, log_end), (seen, seen_end)) = (packets(), packets());
    pipe::fcntl_setpipe_size(&log_end, PAGE).unwrap();
    let mut command = program(name);
    let _cache = OwnCache::of(&command);
    command.args(args).env("DESCRY_LOG", "info,worker=debug").stdout(Stdio::null()).stderr(log_end);
    let mut child = KilledOnDrop(command.spawn().unwrap());
    drop(command); // and with it the test's own end of the pipe: a program that ends is seen
    let (mut log, mut seen) = (File::from(log), File::from(seen));
    let (mut told, mut packet) = (String::new(), [0; PAGE]);
    let begun = Instant::now();
    loop {
        let length = match pipe::tee(&log, &seen_end, PAGE, SpliceFlags::NONBLOCK) {
            Err(Errno::AGAIN) => {
                assert!(begun.elapsed() < PATIENCE, "{name}: no `{text}` in time\n{told}");
                thread::sleep(Duration::from_millis(1));
                continue;
            }
            length => length.unwrap(),
        };
        assert!(length > 0, "{name}: ended before `{text}`\n{told}");
        seen.read_exact(&mut packet[..length]).unwrap();
        let line = String::from_utf8_lossy(&packet[..length]);
        told += &line;
        if line.contains(text) {
            break;
        }
        log.read_exact(&mut packet[..length]).unwrap();
    }
    child.0.kill().unwrap();
    let status = child.0.wait().unwrap();
    assert_eq!(status.code(), None, "{name}: ended by itself\n{told}");
    Finished { command: name.to_owned(), status, stdout: String::new(), stderr: told }
}

/// So that a test that fails leaves no program behind.
struct KilledOnDrop(Child);

impl Drop for KilledOnDrop {
    fn drop(&mut self) {
        let _ = self.0.kill(); // already gone is as good as killed
        let _ = self.0.wait();
    }
}

/// A program that runs beside the test; killed when dropped.
pub struct Running {
    name: String,
    child: KilledOnDrop,
    stdout: PathBuf,
    stderr: PathBuf,
    _cache: OwnCache,
}

impl Running {
    /// Starts a program whose output goes to files in `folder`.
    pub fn start<A: AsRef<OsStr>>(
        folder: &Path,
        name: &str,
        program_name: &str,
        args: impl IntoIterator<Item = A>,
    ) -> Self {
        let mut command = program(program_name);
        command.args(args);
        Self::spawn(folder, name, command)
    }

    /// Starts a prepared program whose output goes to files in `folder`.
    pub fn spawn(folder: &Path, name: &str, mut command: Command) -> Self {
        let stdout = folder.join(format!("{name}.out"));
        let stderr = folder.join(format!("{name}.err"));
        command.stdout(File::create(&stdout).unwrap()).stderr(File::create(&stderr).unwrap());
        let _cache = OwnCache::of(&command);
        Self { name: name.to_owned(), child: KilledOnDrop(command.spawn().unwrap()), stdout, stderr, _cache }
    }

    /// What it has written to standard error so far.
    pub fn log(&self) -> String {
        fs::read_to_string(&self.stderr).unwrap()
    }

    /// Waits until a line of its log contains `text`, and returns that line.
    #[track_caller]
    pub fn wait_for(&mut self, text: &str) -> String {
        let begun = Instant::now();
        loop {
            let log = self.log();
            if let Some(line) = log.lines().find(|line| line.contains(text)) {
                return line.to_owned();
            }
            let ended = self.child.0.try_wait().unwrap();
            assert!(ended.is_none(), "{}: ended with {ended:?} before `{text}`\n{log}", self.name);
            assert!(begun.elapsed() < PATIENCE, "{}: no `{text}` in time\n{log}", self.name);
            thread::sleep(GLANCE);
        }
    }

    /// Waits until a coordinator has said with which address workers may join, and returns it.
    #[track_caller]
    pub fn join_address(&mut self) -> String {
        self.wait_for("workers may join with").rsplit(' ').next().unwrap().to_owned()
    }

    /// Waits until `state` is true of its log.
    #[track_caller]
    pub fn wait_until(&self, what: &str, state: impl Fn(&str) -> bool) {
        let begun = Instant::now();
        while !state(&self.log()) {
            assert!(begun.elapsed() < PATIENCE, "{}: not {what} in time\n{}", self.name, self.log());
            thread::sleep(GLANCE);
        }
    }

    /// Whether it has not ended.
    pub fn is_running(&mut self) -> bool {
        self.child.0.try_wait().unwrap().is_none()
    }

    /// Waits until it ends.
    #[track_caller]
    pub fn wait(&mut self) -> Finished {
        let begun = Instant::now();
        loop {
            if let Some(status) = self.child.0.try_wait().unwrap() {
                let stdout = fs::read_to_string(&self.stdout).unwrap();
                return Finished { command: self.name.clone(), status, stdout, stderr: self.log() };
            }
            assert!(begun.elapsed() < PATIENCE, "{}: did not end in time\n{}", self.name, self.log());
            thread::sleep(GLANCE);
        }
    }

    /// Resident memory, KiB; `None` once it has ended.
    pub fn resident(&self) -> Option<u64> {
        let status = fs::read_to_string(format!("/proc/{}/status", self.child.0.id())).unwrap();
        let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"))?;
        line.split_whitespace().next().unwrap().parse().ok()
    }

    /// Its process.
    pub fn id(&self) -> u32 {
        self.child.0.id()
    }

    /// Sends a signal by name, such as `KILL`.
    pub fn signal(&self, signal: &str) {
        let status =
            Command::new("kill").arg(format!("-{signal}")).arg(self.child.0.id().to_string()).status();
        assert!(status.unwrap().success(), "{}: kill -{signal}", self.name);
    }
}

/// What `DESCRY_VECTORS` may ask for on this machine, beside the widest vectors.
pub fn narrower_vectors() -> Vec<&'static str> {
    let has_avx2 = fs::read_to_string("/proc/cpuinfo").is_ok_and(|it| it.contains(" avx2 "));
    if cfg!(target_arch = "x86_64") && has_avx2 { vec!["baseline", "v3"] } else { vec!["baseline"] }
}

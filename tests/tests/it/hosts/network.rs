//! Three hosts on one machine: network namespaces, joined by two links that can be cut, slowed and made lossy.

use std::ffi::OsStr;
use std::process::Command;
use std::sync::atomic::{AtomicU32, Ordering};

use crate::process::finish;

/// A host of its own, with nothing on it but what a test starts there.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Host {
    /// Where the coordinator runs; a link leads from it to each of the others, named after the other.
    Hub,
    /// A worker's host whose link nobody disturbs.
    Near,
    /// A worker's host whose link is disturbed.
    Far,
}

impl Host {
    /// Its address, the same on each of its links.
    pub fn address(self) -> &'static str {
        match self {
            Self::Hub => "10.77.0.1",
            Self::Near => "10.77.0.2",
            Self::Far => "10.77.0.3",
        }
    }

    fn name(self) -> &'static str {
        match self {
            Self::Hub => "hub",
            Self::Near => "near",
            Self::Far => "far",
        }
    }
}

/// What can be done to the link between [`Host::Hub`] and [`Host::Far`], for as long as it is wanted.
#[derive(Clone, Copy, Debug)]
pub enum Fault {
    /// Nothing arrives, on either side.
    Partition,
    /// Whatever the far host sends is answered with a reset.
    Reset,
    /// Of what arrives, on either side, three packets of ten do not.
    Loss,
    /// One megabit a second, in either direction.
    Slow,
}

/// The three hosts; gone when dropped.
pub struct Network {
    prefix: String,
}

impl Network {
    /// Makes the hosts; `None`, with a line that says why, on a machine that cannot have them and need not.
    pub fn new() -> Option<Self> {
        static MADE: AtomicU32 = AtomicU32::new(0);
        let number = MADE.fetch_add(1, Ordering::Relaxed);
        let network = Self { prefix: format!("descry-{}-{number}", std::process::id()) };
        let Err(reason) = network.make() else { return Some(network) };
        let required = std::env::var_os("DESCRY_REQUIRE_HOSTS").is_some_and(|value| value == "1");
        assert!(!required, "hosts: {reason}");
        eprintln!("SKIPPED: hosts need root, iproute2 and iptables: {}", reason.trim_end());
        None
    }

    fn make(&self) -> Result<(), String> {
        for host in [Host::Hub, Host::Near, Host::Far] {
            attempt("ip", ["netns", "add", &self.namespace(host)])?;
        }
        attempt("ip", ["netns", "exec", &self.namespace(Host::Hub), "iptables", "-w", "-S"])?;
        for end in [Host::Near, Host::Far] {
            let (hub, other) = (self.namespace(Host::Hub), self.namespace(end));
            let veth =
                ["link", "add", end.name(), "netns", &hub, "type", "veth", "peer", "hub", "netns", &other];
            attempt("ip", veth)?;
            self.join(Host::Hub, end)?;
            self.join(end, Host::Hub)?;
        }
        Ok(())
    }

    /// Puts one end of a link into service.
    fn join(&self, host: Host, peer: Host) -> Result<(), String> {
        let (namespace, link) = (self.namespace(host), peer.name());
        let addresses = ["addr", "add", host.address(), "peer", peer.address(), "dev", link];
        attempt("ip", ["-n", &namespace].into_iter().chain(addresses))?;
        attempt("ip", ["-n", &namespace, "link", "set", link, "up"])
    }

    fn namespace(&self, host: Host) -> String {
        format!("{}-{}", self.prefix, host.name())
    }

    /// The same program, on a host: its process is the program's own.
    pub fn on(&self, host: Host, program: &Command) -> Command {
        let mut command = Command::new("ip");
        command
            .args(["netns", "exec", &self.namespace(host)])
            .arg(program.get_program())
            .args(program.get_args());
        for (name, value) in program.get_envs() {
            match value {
                Some(value) => command.env(name, value),
                None => command.env_remove(name),
            };
        }
        command
    }

    /// Begins a fault.
    pub fn inject(&self, fault: Fault) {
        let (hub, far) = (Host::Hub, Host::Far);
        let from_far = ["-A", "INPUT", "-s", far.address(), "-j"];
        let from_hub = ["-A", "INPUT", "-s", hub.address(), "-j"];
        let loss = ["DROP", "-m", "statistic", "--mode", "random", "--probability", "0.3"];
        match fault {
            Fault::Partition => {
                self.iptables(hub, &[&from_far[..], &["DROP"]].concat());
                self.iptables(far, &[&from_hub[..], &["DROP"]].concat());
            }
            Fault::Reset => {
                let reset = ["REJECT", "-p", "tcp", "--reject-with", "tcp-reset"];
                self.iptables(hub, &[&from_far[..], &reset].concat());
            }
            Fault::Loss => {
                self.iptables(hub, &[&from_far[..], &loss].concat());
                self.iptables(far, &[&from_hub[..], &loss].concat());
            }
            Fault::Slow => {
                for (host, link) in [(hub, "far"), (far, "hub")] {
                    let bucket = ["tbf", "rate", "1mbit", "burst", "16kb", "latency", "400ms"];
                    self.run(host, &[&["tc", "qdisc", "add", "dev", link, "root"][..], &bucket].concat());
                }
            }
        }
    }

    /// Ends all faults that packets are filtered by.
    pub fn heal(&self) {
        for host in [Host::Hub, Host::Far] {
            self.iptables(host, &["-F"]);
        }
    }

    /// How many packets faults have stopped or held up since they began.
    pub fn disturbed(&self) -> u64 {
        let ends = [(Host::Hub, "far"), (Host::Far, "hub")];
        ends.iter().map(|&(host, link)| self.filtered(host) + self.held_up(host, link)).sum()
    }

    fn filtered(&self, host: Host) -> u64 {
        let rules = self.iptables(host, &["-L", "INPUT", "-n", "-v", "-x"]);
        // Two lines of headings; a rule begins with the number of its packets.
        rules.lines().skip(2).map(|rule| leading_number(rule.trim_start())).sum()
    }

    fn held_up(&self, host: Host, link: &str) -> u64 {
        let queue = self.run(host, &["tc", "-s", "qdisc", "show", "dev", link]);
        queue.split_once("overlimits ").map_or(0, |(_, rest)| leading_number(rest))
    }

    /// Takes the far host's end of its link down while `cut` runs.
    pub fn flap(&self, cut: impl FnOnce()) {
        self.run(Host::Far, &["ip", "link", "set", "hub", "down"]);
        cut();
        self.run(Host::Far, &["ip", "link", "set", "hub", "up"]);
    }

    /// How often the far link was lost or came back.
    pub fn carrier_changes(&self) -> u64 {
        leading_number(&self.run(Host::Hub, &["cat", "/sys/class/net/far/carrier_changes"]))
    }

    /// How often either end of the far link has given up waiting for the other to acknowledge what it sent.
    pub fn timeouts(&self) -> u64 {
        [Host::Hub, Host::Far].iter().map(|&host| self.timeouts_of(host)).sum()
    }

    fn timeouts_of(&self, host: Host) -> u64 {
        let counters = self.run(host, &["cat", "/proc/net/netstat"]);
        // A line of names, a line of values.
        let mut lines = counters.lines().filter(|line| line.starts_with("TcpExt: "));
        let (names, values) = (lines.next().unwrap(), lines.next().unwrap());
        let position = names.split(' ').position(|name| name == "TCPTimeouts").unwrap();
        values.split(' ').nth(position).unwrap().parse().unwrap()
    }

    fn iptables(&self, host: Host, args: &[&str]) -> String {
        self.run(host, &[&["iptables", "-w"], args].concat())
    }

    fn run(&self, host: Host, line: &[&str]) -> String {
        let mut command = Command::new(line[0]);
        command.args(&line[1..]);
        finish(&mut self.on(host, &command)).expect_success().stdout
    }
}

impl Drop for Network {
    fn drop(&mut self) {
        for host in [Host::Hub, Host::Near, Host::Far] {
            // Those that were never made are as good as gone.
            let _ = attempt("ip", ["netns", "del", &self.namespace(host)]);
        }
    }
}

/// Runs a system's tool that may be missing or not permitted.
fn attempt<A: AsRef<OsStr>>(tool: &str, args: impl IntoIterator<Item = A>) -> Result<(), String> {
    let mut command = Command::new(tool);
    command.args(args);
    match command.output() {
        Ok(output) if output.status.success() => Ok(()),
        Ok(output) => Err(format!("{command:?}: {}", String::from_utf8_lossy(&output.stderr))),
        Err(error) => Err(format!("{command:?}: {error}")),
    }
}

fn leading_number(text: &str) -> u64 {
    let end = text.find(|c: char| !c.is_ascii_digit()).unwrap_or(text.len());
    text[..end].parse().unwrap()
}

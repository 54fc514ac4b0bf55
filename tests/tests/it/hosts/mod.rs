//! Workers on other hosts, behind links that are cut, reset, lossy, slow, late or come and go.

mod delay;
mod network;

use std::fs;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;
use std::time::{Duration, Instant};

use delay::Proxy;
use network::{Fault, Host, Network};
use serde_json::Value;
use tempfile::TempDir;

use crate::experiments::{Experiment, digest};
use crate::process::{Running, program, run};

/// Long enough to be disturbed, short enough to be done by one worker.
const SEARCH: &str = "[ga]\npopulation = 8\n[stop]\ngenerations = 60\nstagnation = \"off\"\n\
    validation_patience = \"off\"\n[coordinator]\n";
const PORT: u16 = 7700;

/// The search when nobody disturbs it: its digest, and a cache that has all its clouds.
fn undisturbed() -> &'static (Value, PathBuf) {
    static SEARCHED: OnceLock<(Value, PathBuf)> = OnceLock::new();
    static CACHE: OnceLock<TempDir> = OnceLock::new();
    SEARCHED.get_or_init(|| {
        let cache = CACHE.get_or_init(|| TempDir::new().unwrap()).path();
        let finished = Experiment::new(SEARCH).run("out", &["--cache", &cache.display().to_string()]);
        (digest(&finished.expect_success()), cache.to_owned())
    })
}

/// An experiment beside certificates for the host that its coordinator is on.
struct Site {
    experiment: Experiment,
}

impl Site {
    fn new(host: &str, lease_seconds: u32) -> Self {
        let site =
            Self { experiment: Experiment::new(&format!("{SEARCH}lease_seconds = {lease_seconds}\n")) };
        run("coordinator", ["certs", &site.experiment.path("tls"), "--host", host]).expect_success();
        site
    }

    /// A coordinator that listens there and waits for workers.
    fn coordinator(&self, listen: &str) -> Command {
        let mut command = program("coordinator");
        let [toml, out, tls] = ["exp.toml", "out", "tls"].map(|name| self.experiment.path(name));
        command.args(["run", &toml, "--out", &out, "--tls", &tls, "--json"]);
        command.args(["--listen", listen, "--local-workers", "0"]);
        command
    }

    /// A worker that finds the coordinator at this port; what it fetches, it keeps in `cache`.
    fn worker(&self, name: &str, port: u16, cache: &Path) -> Command {
        let join = fs::read_to_string(self.experiment.path("tls/join")).unwrap();
        let mut command = program("worker");
        command.env("DESCRY_COORDINATOR", join.trim().replace(":7700", &format!(":{port}")));
        command.args(["--name", name, "--threads", "1", "--cache"]).arg(cache);
        command
    }

    fn start(&self, name: &str, command: Command) -> Running {
        Running::spawn(self.experiment.folder(), name, command)
    }
}

/// A run on three hosts.
struct Search {
    coordinator: Running,
    site: Site,
    network: Network,
}

impl Search {
    /// A coordinator on its host; `None` where there can be no hosts.
    fn start() -> Option<Self> {
        let network = Network::new()?;
        let address = Host::Hub.address();
        let site = Site::new(address, 2);
        let coordinator = network.on(Host::Hub, &site.coordinator(&format!("{address}:{PORT}")));
        Some(Self { coordinator: site.start("coordinator", coordinator), site, network })
    }

    /// A worker on the far host.
    fn far(&self, cache: &Path) -> Running {
        self.site.start("far", self.network.on(Host::Far, &self.site.worker("far", PORT, cache)))
    }

    /// A worker on the near host, which has all clouds.
    fn near(&self) -> Running {
        let (_, cache) = undisturbed();
        self.site.start("near", self.network.on(Host::Near, &self.site.worker("near", PORT, cache)))
    }

    fn generations(&self) -> usize {
        self.coordinator.log().lines().filter(|line| line.starts_with("generation ")).count()
    }

    /// Waits until another generation is complete.
    fn wait_for_the_next_generation(&mut self) {
        let next = self.generations() + 1;
        self.coordinator.wait_for(&format!("generation {next}/"));
    }

    /// Waits until a line has been in the coordinator's log so many times.
    fn wait_for_times(&self, line: &str, times: usize) {
        self.coordinator
            .wait_until(&format!("`{line}` {times} times"), |log| log.matches(line).count() >= times);
    }

    /// The run ends as if nothing had been.
    fn end(mut self) {
        let finished = self.coordinator.wait().expect_success();
        assert_eq!(digest(&finished), undisturbed().0, "{finished}");
    }
}

/// A worker alone is cut off until its leases end, another one helps out and leaves: only if the first comes back can
/// the run end.
fn cut_off(fault: Fault) {
    let (_, cache) = undisturbed();
    let Some(mut search) = Search::start() else { return };
    let _far = search.far(cache);
    search.coordinator.wait_for("generation 2/");
    search.network.inject(fault);
    search.coordinator.wait_for("worker far: lost");
    let near = search.near();
    search.wait_for_the_next_generation();
    near.signal("TERM");
    search.coordinator.wait_for("worker near: left");
    assert!(search.generations() < 60, "the fault came too late:\n{}", search.coordinator.log());

    let stopped = search.network.disturbed();
    assert!(stopped > 0, "{fault:?} did not fire");
    search.network.heal();
    let healed = Instant::now();
    search.wait_for_times("worker far: joined", 2);
    println!("{fault:?}: {stopped} packets stopped; back {:.1} s after", healed.elapsed().as_secs_f64());
    search.end();
}

/// A worker alone comes so far over a bad link, which stays bad; then another one joins.
fn disturbed_all_the_time(fault: Fault, cache: &Path, so_far: &str) {
    let Some(mut search) = Search::start() else { return };
    search.network.inject(fault);
    let _far = search.far(cache);
    let begun = Instant::now();
    search.coordinator.wait_for(so_far);
    let disturbed = search.network.disturbed();
    assert!(disturbed > 0, "{fault:?} did not fire");
    println!("{fault:?}: {disturbed} packets; `{so_far}` after {:.1} s", begun.elapsed().as_secs_f64());
    let _near = search.near();
    search.end();
}

#[test]
fn a_worker_behind_a_partition_loses_its_jobs_and_comes_back_when_it_heals() {
    cut_off(Fault::Partition);
}

#[test]
fn a_worker_whose_packets_are_answered_with_resets_comes_back_when_they_are_not() {
    cut_off(Fault::Reset);
}

#[test]
fn a_worker_behind_a_link_that_loses_three_packets_of_ten_joins_and_holds_nobody_up() {
    let (_, cache) = undisturbed();
    // Not further: TCP doubles its waits, so that a single exchange may take half a minute.
    disturbed_all_the_time(Fault::Loss, cache, "worker far: joined");
}

#[test]
fn a_worker_behind_a_megabit_a_second_fetches_its_clouds_and_works() {
    let empty = TempDir::new().unwrap();
    disturbed_all_the_time(Fault::Slow, empty.path(), "generation 2/");
}

#[test]
fn a_worker_behind_a_link_that_comes_and_goes_does_the_run_alone() {
    const FLAPS: u64 = 8;
    let (_, cache) = undisturbed();
    let Some(mut search) = Search::start() else { return };
    let far = search.far(cache);
    search.coordinator.wait_for("generation 2/");
    let before = search.network.carrier_changes();
    for flap in 1..=FLAPS {
        search.network.flap(|| {
            if flap % 4 == 0 {
                search.wait_for_times("worker far: lost", flap as usize / 4);
            } else {
                let timeouts = search.network.timeouts();
                far.wait_until("in want of an answer", |_| search.network.timeouts() > timeouts);
            }
        });
        search.wait_for_the_next_generation();
    }
    assert_eq!(search.network.carrier_changes() - before, 2 * FLAPS);
    search.end();
}

#[test]
fn a_worker_two_seconds_away_works() {
    let (undisturbed, cache) = undisturbed();
    // A poll and its answer must fit into a lease.
    let site = Site::new("127.0.0.1", 15);
    let mut coordinator = site.start("coordinator", site.coordinator("127.0.0.1:0"));
    let line = coordinator.wait_for("this port is ");
    let port = line.split("this port is ").nth(1).unwrap().split(':').next().unwrap().parse().unwrap();
    let proxy = Proxy::start(SocketAddr::from(([127, 0, 0, 1], port)), Duration::from_secs(2));
    let mut away = site.start("away", site.worker("away", proxy.address.port(), cache));
    away.wait_for("joined as away");
    let begun = Instant::now();
    coordinator.wait_for("generation 1/");
    println!("two seconds away: generation 1 after {:.1} s", begun.elapsed().as_secs_f64());
    let _here = site.start("here", site.worker("here", port, cache));
    let finished = coordinator.wait().expect_success();
    assert_eq!(digest(&finished), *undisturbed, "{finished}");
    assert!(proxy.carried() > 0);
}

//! How much one peer may ask for: connections by address, calls by time. Plain decisions, without IO.

use std::collections::HashMap;
use std::net::{IpAddr, Ipv6Addr};
use std::time::{Duration, Instant};

/// Connections that are open at once.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CrowdLimits {
    /// In all.
    pub all: usize,
    /// From one origin: workers behind one NAT have one address.
    pub origin: usize,
    /// In all, of those that have not made a call yet.
    pub newcomers: usize,
    /// From one origin, of those that have not made a call yet.
    pub origin_newcomers: usize,
}

impl CrowdLimits {
    /// Room for 10 000 workers, and for 2000 that arrive at the same instant from one address.
    const DEFAULT: Self = Self { all: 12_000, origin: 4_096, newcomers: 4_096, origin_newcomers: 2_048 };
    /// Open files that are left for everything but connections.
    const RESERVE: usize = 256;

    /// Limits for a process that may have this many files open: connections never take the last one.
    pub fn within(open_files: usize) -> Self {
        let all = Self::DEFAULT.all.min(open_files.saturating_sub(Self::RESERVE)).max(1);
        Self {
            all,
            origin: Self::DEFAULT.origin.min(all),
            newcomers: Self::DEFAULT.newcomers.min(all.div_ceil(2)),
            origin_newcomers: Self::DEFAULT.origin_newcomers.min(all.div_ceil(4)),
        }
    }
}

#[derive(Clone, Copy, Debug, Default)]
struct Heads {
    all: usize,
    newcomers: usize,
}

/// Who is connected, by origin.
#[derive(Debug)]
pub struct Crowd {
    limits: CrowdLimits,
    total: Heads,
    origins: HashMap<IpAddr, Heads>,
}

impl Crowd {
    /// Nobody.
    pub fn new(limits: CrowdLimits) -> Self {
        Self { limits, total: Heads::default(), origins: HashMap::new() }
    }

    /// Counts a connection in, as a newcomer, if there is room for it.
    pub fn admit(&mut self, address: IpAddr) -> bool {
        let heads = self.origins.get(&origin(address)).copied().unwrap_or_default();
        let fits = self.total.all < self.limits.all
            && self.total.newcomers < self.limits.newcomers
            && heads.all < self.limits.origin
            && heads.newcomers < self.limits.origin_newcomers;
        if fits {
            for heads in [&mut self.total, self.origins.entry(origin(address)).or_default()] {
                heads.all += 1;
                heads.newcomers += 1;
            }
        }
        fits
    }

    /// A newcomer has made its first call.
    pub fn settle(&mut self, address: IpAddr) {
        for heads in [&mut self.total, self.origins.entry(origin(address)).or_default()] {
            heads.newcomers = heads.newcomers.saturating_sub(1);
        }
    }

    /// Counts a connection out.
    pub fn leave(&mut self, address: IpAddr, settled: bool) {
        let origin = origin(address);
        for heads in [&mut self.total, self.origins.entry(origin).or_default()] {
            heads.all = heads.all.saturating_sub(1);
            heads.newcomers = heads.newcomers.saturating_sub(usize::from(!settled));
        }
        if self.origins.get(&origin).is_some_and(|heads| heads.all == 0) {
            self.origins.remove(&origin); // whoever was here once must not fill the memory
        }
    }
}

/// What one peer can hardly change: an IPv4 address, or the /64 in which it may choose any IPv6 address.
fn origin(address: IpAddr) -> IpAddr {
    match address.to_canonical() {
        IpAddr::V6(address) => {
            let [a, b, c, d, ..] = address.segments();
            Ipv6Addr::new(a, b, c, d, 0, 0, 0, 0).into()
        }
        v4 => v4,
    }
}

/// At most so many at once, and one more each `interval`.
#[derive(Clone, Debug)]
pub struct Rate {
    interval: Duration,
    burst: u32,
    /// When as many are free again as at first.
    full: Option<Instant>,
}

impl Rate {
    /// Nothing used yet.
    pub fn new(burst: u32, interval: Duration) -> Self {
        Self { interval, burst, full: None }
    }

    /// How long the next one has to wait; zero if it may come now.
    pub fn wait(&self, now: Instant) -> Duration {
        let Some(full) = self.full else { return Duration::ZERO };
        (full + self.interval).saturating_duration_since(now).saturating_sub(self.interval * self.burst)
    }

    /// Uses one, now or after [`Rate::wait`].
    pub fn take(&mut self, now: Instant) {
        self.full = Some(self.full.map_or(now, |full| full.max(now)) + self.interval);
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const LIMITS: CrowdLimits = CrowdLimits { all: 5, origin: 3, newcomers: 4, origin_newcomers: 2 };

    fn ip(last: u8) -> IpAddr {
        [192, 0, 2, last].into()
    }

    #[test]
    fn one_origin_cannot_take_the_room_of_others() {
        let mut crowd = Crowd::new(LIMITS);
        assert!(crowd.admit(ip(1)) && crowd.admit(ip(1)));
        assert!(!crowd.admit(ip(1)), "a third newcomer");
        crowd.settle(ip(1));
        assert!(crowd.admit(ip(1)));
        crowd.settle(ip(1));
        assert!(!crowd.admit(ip(1)), "a fourth connection");
        assert!(crowd.admit(ip(2)) && crowd.admit(ip(3)));
        assert!(!crowd.admit(ip(4)), "a sixth in all");
        crowd.leave(ip(1), true);
        assert!(crowd.admit(ip(4)));
    }

    #[test]
    fn an_origin_is_an_ipv4_address_or_a_64_of_ipv6() {
        let same = |a: &str, b: &str| origin(a.parse().unwrap()) == origin(b.parse().unwrap());
        assert!(same("2001:db8::1", "2001:db8::ffff:2"));
        assert!(!same("2001:db8::1", "2001:db8:0:1::1"));
        assert!(same("::ffff:192.0.2.7", "192.0.2.7"));
        assert!(!same("192.0.2.7", "192.0.2.8"));
    }

    #[test]
    fn connections_never_take_the_last_open_file() {
        for open_files in [0, 1, 256, 1024, 20_000, usize::MAX] {
            let limits = CrowdLimits::within(open_files);
            assert!(limits.all >= 1 && limits.all <= 12_000, "{open_files}: {limits:?}");
            assert!(limits.all + 256 <= open_files.max(257), "{open_files}: {limits:?}");
            assert!(limits.newcomers >= limits.origin_newcomers && limits.origin_newcomers >= 1);
        }
        assert_eq!(CrowdLimits::within(20_000), CrowdLimits::DEFAULT);
    }

    #[test]
    fn a_burst_passes_and_then_one_each_interval() {
        let begin = Instant::now();
        let mut rate = Rate::new(3, Duration::from_secs(1));
        for _ in 0..3 {
            assert_eq!(rate.wait(begin), Duration::ZERO);
            rate.take(begin);
        }
        assert_eq!(rate.wait(begin), Duration::from_secs(1));
        let later = begin + Duration::from_secs(1);
        assert_eq!(rate.wait(later), Duration::ZERO);
        rate.take(later);
        assert_eq!(rate.wait(later), Duration::from_secs(1));
        assert_eq!(rate.wait(later + Duration::from_secs(9)), Duration::ZERO);
    }

    proptest! {
        #[test]
        fn counts_return_to_zero(moves in prop::collection::vec((0u8..4, 0u8..3), 0..200)) {
            let mut crowd = Crowd::new(LIMITS);
            let mut here: Vec<(u8, bool)> = Vec::new();
            for (address, what) in moves {
                let place = here.iter().position(|(other, _)| *other == address);
                match (what, place) {
                    (0, _) => here.extend(crowd.admit(ip(address)).then_some((address, false))),
                    (1, Some(place)) if !here[place].1 => {
                        crowd.settle(ip(address));
                        here[place].1 = true;
                    }
                    (2, Some(place)) => {
                        let (_, settled) = here.remove(place);
                        crowd.leave(ip(address), settled);
                    }
                    _ => {}
                }
                prop_assert_eq!(crowd.total.all, here.len());
                prop_assert_eq!(crowd.total.newcomers, here.iter().filter(|(_, settled)| !settled).count());
                prop_assert!(here.len() <= LIMITS.all);
            }
            for (address, settled) in here {
                crowd.leave(ip(address), settled);
            }
            prop_assert!(crowd.origins.is_empty());
        }
    }
}

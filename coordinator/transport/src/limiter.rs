//! Limits of connections by address, and of calls by time.

use std::collections::HashMap;
use std::net::IpAddr;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use proto::Origin;

/// Connections that are open at once.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ConnectionLimits {
    /// In all.
    pub all: usize,
    /// From one origin: workers behind one NAT have one address.
    pub origin: usize,
    /// In all, of those that are pending: no call of theirs was let in yet.
    pub pending: usize,
    /// From one origin, of those that are pending.
    pub origin_pending: usize,
}

impl ConnectionLimits {
    /// Enough for 10 000 workers, and for 2000 that connect at the same instant from one address.
    const DEFAULT: Self = Self { all: 12_000, origin: 4_096, pending: 4_096, origin_pending: 2_048 };
    /// Open files that are left for everything but connections.
    const RESERVE: usize = 256;

    /// Limits for a process that may have this many files open: connections never take the last one.
    pub fn within(open_files: usize) -> Self {
        let all = Self::DEFAULT.all.min(open_files.saturating_sub(Self::RESERVE)).max(1);
        Self {
            all,
            origin: Self::DEFAULT.origin.min(all),
            pending: Self::DEFAULT.pending.min(all.div_ceil(2)),
            origin_pending: Self::DEFAULT.origin_pending.min(all.div_ceil(4)),
        }
    }
}

#[derive(Clone, Copy, Debug, Default)]
struct Counts {
    all: usize,
    pending: usize,
}

/// Open connections by origin.
#[derive(Debug)]
pub struct ConnectionCounts {
    limits: ConnectionLimits,
    total: Counts,
    origins: HashMap<Origin, Counts>,
}

impl ConnectionCounts {
    /// No connection.
    pub fn new(limits: ConnectionLimits) -> Self {
        Self { limits, total: Counts::default(), origins: HashMap::new() }
    }

    /// Counts a connection in, as pending, if the limits allow it.
    pub fn admit(&mut self, address: IpAddr) -> bool {
        let counts = self.origins.get(&Origin::of(address)).copied().unwrap_or_default();
        let fits = self.total.all < self.limits.all
            && self.total.pending < self.limits.pending
            && counts.all < self.limits.origin
            && counts.pending < self.limits.origin_pending;
        if fits {
            for counts in [&mut self.total, self.origins.entry(Origin::of(address)).or_default()] {
                counts.all += 1;
                counts.pending += 1;
            }
        }
        fits
    }

    /// A pending connection has had its first call let in.
    pub fn establish(&mut self, address: IpAddr) {
        for counts in [&mut self.total, self.origins.entry(Origin::of(address)).or_default()] {
            counts.pending = counts.pending.saturating_sub(1);
        }
    }

    /// Counts a connection out.
    pub fn leave(&mut self, address: IpAddr, established: bool) {
        let origin = Origin::of(address);
        for counts in [&mut self.total, self.origins.entry(origin).or_default()] {
            counts.all = counts.all.saturating_sub(1);
            counts.pending = counts.pending.saturating_sub(usize::from(!established));
        }
        if self.origins.get(&origin).is_some_and(|counts| counts.all == 0) {
            self.origins.remove(&origin); // addresses seen once must not fill the memory
        }
    }
}

/// Open connections of one coordinator.
pub struct ConnectionLimiter(Mutex<ConnectionCounts>);

impl ConnectionLimiter {
    /// No connection.
    pub fn new(limits: ConnectionLimits) -> Arc<Self> {
        Arc::new(Self(Mutex::new(ConnectionCounts::new(limits))))
    }

    /// A permit for one more connection, if the limits allow it.
    pub fn acquire(self: &Arc<Self>, address: IpAddr) -> Option<ConnectionPermit> {
        let permit =
            || ConnectionPermit { limiter: Arc::clone(self), address, established: AtomicBool::new(false) };
        self.counts().admit(address).then(permit)
    }

    fn counts(&self) -> MutexGuard<'_, ConnectionCounts> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Counts for one connection from its beginning until it is dropped.
pub struct ConnectionPermit {
    limiter: Arc<ConnectionLimiter>,
    address: IpAddr,
    established: AtomicBool,
}

impl ConnectionPermit {
    /// The peer.
    pub fn address(&self) -> IpAddr {
        self.address
    }

    /// A call of this connection was let in: it is pending no longer.
    pub fn establish(&self) {
        if !self.established.swap(true, Ordering::Relaxed) {
            self.limiter.counts().establish(self.address);
        }
    }

    /// Whether a call of this connection was let in.
    pub fn is_established(&self) -> bool {
        self.established.load(Ordering::Relaxed)
    }
}

impl Drop for ConnectionPermit {
    fn drop(&mut self) {
        self.limiter.counts().leave(self.address, self.is_established());
    }
}

/// At most so many at once, and one more each `interval`.
#[derive(Clone, Debug)]
pub struct RateLimit {
    interval: Duration,
    burst: u32,
    /// When as many are free again as at first.
    full: Option<Instant>,
}

impl RateLimit {
    /// Nothing used yet.
    pub fn new(burst: u32, interval: Duration) -> Self {
        Self { interval, burst, full: None }
    }

    /// How long the next one has to wait; zero if it may come now.
    pub fn wait(&self, now: Instant) -> Duration {
        let Some(full) = self.full else { return Duration::ZERO };
        (full + self.interval).saturating_duration_since(now).saturating_sub(self.interval * self.burst)
    }

    /// Uses one, now or after [`RateLimit::wait`].
    pub fn take(&mut self, now: Instant) {
        self.full = Some(self.full.map_or(now, |full| full.max(now)) + self.interval);
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const LIMITS: ConnectionLimits = ConnectionLimits { all: 5, origin: 3, pending: 4, origin_pending: 2 };

    fn ip(last: u8) -> IpAddr {
        [192, 0, 2, last].into()
    }

    #[test]
    fn one_origin_cannot_take_the_room_of_others() {
        let mut counts = ConnectionCounts::new(LIMITS);
        assert!(counts.admit(ip(1)) && counts.admit(ip(1)));
        assert!(!counts.admit(ip(1)), "a third pending connection");
        counts.establish(ip(1));
        assert!(counts.admit(ip(1)));
        counts.establish(ip(1));
        assert!(!counts.admit(ip(1)), "a fourth connection");
        assert!(counts.admit(ip(2)) && counts.admit(ip(3)));
        assert!(!counts.admit(ip(4)), "a sixth in all");
        counts.leave(ip(1), true);
        assert!(counts.admit(ip(4)));
    }

    #[test]
    fn connections_never_take_the_last_open_file() {
        for open_files in [0, 1, 256, 1024, 20_000, usize::MAX] {
            let limits = ConnectionLimits::within(open_files);
            assert!(limits.all >= 1 && limits.all <= 12_000, "{open_files}: {limits:?}");
            assert!(limits.all + 256 <= open_files.max(257), "{open_files}: {limits:?}");
            assert!(limits.pending >= limits.origin_pending && limits.origin_pending >= 1);
        }
        assert_eq!(ConnectionLimits::within(20_000), ConnectionLimits::DEFAULT);
    }

    #[test]
    fn a_burst_passes_and_then_one_each_interval() {
        let begin = Instant::now();
        let mut rate = RateLimit::new(3, Duration::from_secs(1));
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
            let mut counts = ConnectionCounts::new(LIMITS);
            let mut here: Vec<(u8, bool)> = Vec::new();
            for (address, what) in moves {
                let place = here.iter().position(|(other, _)| *other == address);
                match (what, place) {
                    (0, _) => here.extend(counts.admit(ip(address)).then_some((address, false))),
                    (1, Some(place)) if !here[place].1 => {
                        counts.establish(ip(address));
                        here[place].1 = true;
                    }
                    (2, Some(place)) => {
                        let (_, established) = here.remove(place);
                        counts.leave(ip(address), established);
                    }
                    _ => {}
                }
                prop_assert_eq!(counts.total.all, here.len());
                prop_assert_eq!(counts.total.pending, here.iter().filter(|(_, established)| !established).count());
                prop_assert!(here.len() <= LIMITS.all);
            }
            for (address, established) in here {
                counts.leave(ip(address), established);
            }
            prop_assert!(counts.origins.is_empty());
        }
    }
}

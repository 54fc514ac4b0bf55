//! Who may come in and who has to go: what all connections of one coordinator have in common.

use std::collections::BTreeMap;
use std::net::IpAddr;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, RwLock, Weak};

use proto::Token;
use tonic::Status;

use crate::door::deny::Denied;
use crate::door::guest::Guest;
use crate::door::limits::{Crowd, CrowdLimits};
use cluster::Cluster;

/// What lets a call in.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Key {
    /// The connection came over plain text, where everybody may call.
    None,
    /// A certificate of the CA, or this token if there is one.
    Credentials(Option<Token>),
}

/// Keeps the books of one coordinator's connections.
pub struct Gate {
    cluster: Arc<Cluster>,
    key: Key,
    denied: RwLock<Denied>,
    crowd: Mutex<Crowd>,
    guests: Mutex<BTreeMap<u64, Weak<Guest>>>,
    next_guest: AtomicU64,
    /// How often strangers were stopped, by reason.
    stopped: Mutex<BTreeMap<&'static str, u64>>,
}

impl Gate {
    /// A gate that nobody has come to yet.
    pub fn new(cluster: Arc<Cluster>, key: Key, limits: CrowdLimits) -> Arc<Self> {
        Arc::new(Self {
            cluster,
            key,
            denied: RwLock::default(),
            crowd: Mutex::new(Crowd::new(limits)),
            guests: Mutex::default(),
            next_guest: AtomicU64::new(0),
            stopped: Mutex::default(),
        })
    }

    /// Counts a connection in, if there is room for it.
    pub fn admit(self: &Arc<Self>, address: IpAddr) -> Option<Presence> {
        let fits = lock(&self.crowd).admit(address);
        if !fits {
            self.note_stopped("too many connections", address);
        }
        fits.then(|| Presence { gate: Arc::clone(self), address, settled: AtomicBool::new(false) })
    }

    /// Puts a guest on the list of those who can be shown out.
    pub fn enter(&self, guest: &Arc<Guest>) {
        let number = self.next_guest.fetch_add(1, Ordering::Relaxed);
        let mut guests = lock(&self.guests);
        if number.is_multiple_of(256) {
            guests.retain(|_, guest| guest.strong_count() > 0);
        }
        guests.insert(number, Arc::downgrade(guest));
    }

    /// Whether a guest that shows this `authorization` may call.
    pub fn check(&self, guest: &Guest, authorization: Option<&str>) -> Result<(), Status> {
        let Key::Credentials(token) = &self.key else { return Ok(()) };
        let shown = authorization.and_then(|value| value.strip_prefix("Bearer ")?.parse::<Token>().ok());
        let denied = self.denied.read().unwrap_or_else(PoisonError::into_inner);
        if guest.certificate.is_some_and(|certificate| denied.certificates.contains(&certificate)) {
            return Err(Status::permission_denied(
                "the certificate of this worker is on the coordinator's deny list\nask whoever runs the coordinator for another",
            ));
        }
        if guest.certificate.is_some() {
            return Ok(());
        }
        match (shown, token) {
            (Some(shown), Some(token)) if shown == *token => {
                guest.shows_token.store(true, Ordering::Relaxed);
                if denied.token {
                    return Err(Status::permission_denied(
                        "the token is on the coordinator's deny list\nask whoever runs the coordinator for a certificate",
                    ));
                }
                Ok(())
            }
            _ => Err(Status::unauthenticated(
                "this worker shows neither a token nor a certificate of this coordinator\ntake the join address that `coordinator certs` has made, with its token, or use --tls",
            )),
        }
    }

    /// Puts another deny list in force, and shows out whom it names: their leases are free at once.
    pub fn deny(&self, denied: Denied) {
        *self.denied.write().unwrap_or_else(PoisonError::into_inner) = denied.clone();
        let guests: Vec<Arc<Guest>> = lock(&self.guests).values().filter_map(Weak::upgrade).collect();
        for guest in guests {
            let is_denied = match guest.certificate {
                Some(certificate) => denied.certificates.contains(&certificate),
                None => denied.token && guest.shows_token.load(Ordering::Relaxed),
            };
            if is_denied {
                for worker in guest.workers() {
                    self.cluster.deny(worker);
                }
                self.stop(&guest, "on the deny list");
            }
        }
    }

    /// Closes a guest's connection as soon as it can have read why.
    pub fn stop(&self, guest: &Guest, reason: &'static str) {
        if guest.close() {
            self.note_stopped(reason, guest.address());
        }
    }

    /// Says how often this has happened, less and less often: strangers must not fill the log either.
    pub fn note_stopped(&self, reason: &'static str, address: IpAddr) {
        let count = {
            let mut stopped = lock(&self.stopped);
            let count = stopped.entry(reason).or_default();
            *count += 1;
            *count
        };
        if count.is_power_of_two() {
            tracing::warn!("door: {reason}: {count} stopped so far, the last from {address}");
        }
    }
}

/// One connection, as the gate counts it, from its beginning to its end.
pub struct Presence {
    gate: Arc<Gate>,
    address: IpAddr,
    settled: AtomicBool,
}

impl Presence {
    /// Where it comes from.
    pub fn address(&self) -> IpAddr {
        self.address
    }

    /// The gate that counts it.
    pub fn gate(&self) -> &Arc<Gate> {
        &self.gate
    }

    /// It has made a call that was let in: it is no newcomer any more.
    pub fn settle(&self) {
        if !self.settled.swap(true, Ordering::Relaxed) {
            lock(&self.gate.crowd).settle(self.address);
        }
    }

    /// Whether it has made a call that was let in.
    pub fn is_settled(&self) -> bool {
        self.settled.load(Ordering::Relaxed)
    }
}

impl Drop for Presence {
    fn drop(&mut self) {
        lock(&self.gate.crowd).leave(self.address, self.is_settled());
    }
}

/// Books are kept in single steps: a panic elsewhere leaves none half made.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {

    use proto::Fingerprint;
    use tonic::Code;

    use super::*;
    use cluster::scheduler::Limits;

    fn gate(key: Key) -> Arc<Gate> {
        Gate::new(Cluster::new(Limits::SAMPLE), key, CrowdLimits::within(1024))
    }

    fn guest(gate: &Arc<Gate>, certificate: Option<Fingerprint>) -> Arc<Guest> {
        Guest::new(gate.admit([192, 0, 2, 7].into()).unwrap(), certificate)
    }

    #[tokio::test]
    async fn a_token_or_a_certificate_lets_in_until_it_is_denied() {
        let token = Token::new([7; 32]);
        let shown = format!("Bearer {}", token.reveal());
        let wrong = format!("Bearer {}", Token::new([8; 32]).reveal());
        let gate = gate(Key::Credentials(Some(token.clone())));
        let [stranger, first, second] =
            [None, Some(1), Some(2)].map(|print| guest(&gate, print.map(|byte| Fingerprint([byte; 32]))));
        let check = |guest: &Guest, shown: Option<&str>| gate.check(guest, shown).map_err(|s| s.code());
        for refused in [None, Some(wrong.as_str()), Some(&shown[7..]), Some("Bearer "), Some("")] {
            assert_eq!(check(&stranger, refused), Err(Code::Unauthenticated), "{refused:?}");
        }
        assert_eq!(check(&stranger, Some(&shown)), Ok(()));
        assert_eq!(check(&first, None), Ok(()));

        gate.deny(Denied { certificates: [Fingerprint([1; 32])].into(), token: false });
        assert_eq!(check(&first, None), Err(Code::PermissionDenied));
        assert_eq!(check(&first, Some(&shown)), Err(Code::PermissionDenied), "the token does not help it");
        assert_eq!(check(&second, None), Ok(()));
        assert_eq!(check(&stranger, Some(&shown)), Ok(()));
        gate.deny(Denied { certificates: [].into(), token: true });
        assert_eq!(check(&first, None), Ok(()), "not on the list any more");
        assert_eq!(check(&stranger, Some(&shown)), Err(Code::PermissionDenied));
    }

    #[tokio::test]
    async fn without_a_token_only_certificates_let_in_and_plain_text_needs_nothing() {
        let only = gate(Key::Credentials(None));
        let zeros = format!("Bearer {}", Token::new([0; 32]).reveal());
        assert!(only.check(&guest(&only, None), Some(&zeros)).is_err());
        assert!(only.check(&guest(&only, Some(Fingerprint([1; 32]))), None).is_ok());
        let plain = gate(Key::None);
        assert!(plain.check(&guest(&plain, None), None).is_ok());
    }
}

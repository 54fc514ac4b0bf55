//! Access control: which calls are let in, and which connections end because of the deny list.

use std::collections::BTreeMap;
use std::net::IpAddr;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, RwLock, Weak};

use proto::{Fingerprint, MAX_MESSAGE_BYTES, Token};
use tonic::Status;

use crate::budget::RequestBudget;
use crate::connection::Connection;
use crate::deny_list::Denied;
use crate::limiter::{ConnectionLimiter, ConnectionLimits, ConnectionPermit};
use crate::refusals::RefusalLog;
use cluster::Cluster;

/// Bytes of requests that are not whole, over all connections: of the largest messages, eight.
const MAX_REQUEST_BYTES: usize = 8 * MAX_MESSAGE_BYTES;

/// What a call has to show.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Requirement {
    /// Nothing: the connection is plain text, over which everybody may call.
    Nothing,
    /// A certificate of the CA, or this token if there is one.
    Credential(Option<Token>),
}

/// Access to one coordinator.
pub struct AccessControl {
    cluster: Arc<Cluster>,
    requirement: Requirement,
    denied: RwLock<Denied>,
    limiter: Arc<ConnectionLimiter>,
    connections: Mutex<BTreeMap<u64, Weak<Connection>>>,
    next_connection: AtomicU64,
    /// Memory for requests that are not whole.
    pub requests: Arc<RequestBudget>,
    /// Peers that were refused.
    pub refusals: Arc<RefusalLog>,
}

impl AccessControl {
    /// Without connections yet.
    pub fn new(
        cluster: Arc<Cluster>,
        requirement: Requirement,
        limits: ConnectionLimits,
        refusals: Arc<RefusalLog>,
    ) -> Arc<Self> {
        Arc::new(Self {
            cluster,
            requirement,
            denied: RwLock::default(),
            limiter: ConnectionLimiter::new(limits),
            connections: Mutex::default(),
            next_connection: AtomicU64::new(0),
            requests: RequestBudget::new(MAX_REQUEST_BYTES),
            refusals,
        })
    }

    /// A permit for a connection that was just accepted, if the limits allow it.
    pub fn admit(&self, address: IpAddr) -> Option<ConnectionPermit> {
        let permit = self.limiter.acquire(address);
        if permit.is_none() {
            self.refusals.note("too many connections", address);
        }
        permit
    }

    /// A connection that has shaken hands, with the fingerprint of the certificate that its peer has shown.
    pub fn connect(&self, permit: ConnectionPermit, certificate: Option<Fingerprint>) -> Arc<Connection> {
        let connection = Connection::new(permit, certificate, Arc::clone(&self.refusals));
        let number = self.next_connection.fetch_add(1, Ordering::Relaxed);
        let mut connections = lock(&self.connections);
        if number.is_multiple_of(256) {
            connections.retain(|_, connection| connection.strong_count() > 0);
        }
        connections.insert(number, Arc::downgrade(&connection));
        connection
    }

    /// Lets a call with this `authorization` in, or says why not.
    pub fn check(&self, connection: &Connection, authorization: Option<&str>) -> Result<(), Status> {
        let Requirement::Credential(token) = &self.requirement else { return Ok(()) };
        let shown = authorization.and_then(|value| value.strip_prefix("Bearer ")?.parse::<Token>().ok());
        let denied = self.denied.read().unwrap_or_else(PoisonError::into_inner);
        if connection.certificate.is_some_and(|certificate| denied.certificates.contains(&certificate)) {
            return Err(Status::permission_denied(
                "the certificate of this worker is on the coordinator's deny list\nask whoever runs the coordinator for another",
            ));
        }
        if connection.certificate.is_some() {
            return Ok(());
        }
        match (shown, token) {
            (Some(shown), Some(token)) if shown == *token => {
                connection.shows_token.store(true, Ordering::Relaxed);
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

    /// Puts another deny list in force, and closes the connections that it names: the leases of their workers are free at
    /// once.
    pub fn deny(&self, denied: Denied) {
        *self.denied.write().unwrap_or_else(PoisonError::into_inner) = denied.clone();
        for connection in self.connections() {
            let is_denied = match connection.certificate {
                Some(certificate) => denied.certificates.contains(&certificate),
                None => denied.token && connection.shows_token.load(Ordering::Relaxed),
            };
            if is_denied {
                for worker in connection.workers() {
                    self.cluster.deny(worker);
                }
                self.stop(&connection, "on the deny list");
            }
        }
    }

    /// Closes all connections: nobody serves them any more, and whoever is at the other end has to look for the next server
    /// at this address.
    pub fn close(&self) {
        for connection in self.connections() {
            connection.close();
        }
    }

    fn connections(&self) -> Vec<Arc<Connection>> {
        lock(&self.connections).values().filter_map(Weak::upgrade).collect()
    }

    /// Closes a connection as soon as its peer can have read why.
    pub fn stop(&self, connection: &Connection, reason: &'static str) {
        if connection.close() {
            self.refusals.note(reason, connection.address());
        }
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {

    use tonic::Code;

    use super::*;

    use cluster::scheduler::Limits;

    fn access(requirement: Requirement) -> Arc<AccessControl> {
        let connections = ConnectionLimits::within(1024);
        AccessControl::new(Cluster::new(Limits::SAMPLE), requirement, connections, Arc::default())
    }

    fn connection(access: &AccessControl, certificate: Option<Fingerprint>) -> Arc<Connection> {
        access.connect(access.admit([192, 0, 2, 7].into()).unwrap(), certificate)
    }

    #[tokio::test]
    async fn a_token_or_a_certificate_lets_in_until_it_is_denied() {
        let token = Token::new([7; 32]);
        let shown = format!("Bearer {}", token.reveal());
        let wrong = format!("Bearer {}", Token::new([8; 32]).reveal());
        let access = access(Requirement::Credential(Some(token.clone())));
        let [stranger, first, second] = [None, Some(1), Some(2)]
            .map(|print| connection(&access, print.map(|byte| Fingerprint([byte; 32]))));
        let check = |connection: &Connection, shown: Option<&str>| {
            access.check(connection, shown).map_err(|s| s.code())
        };
        for refused in [None, Some(wrong.as_str()), Some(&shown[7..]), Some("Bearer "), Some("")] {
            assert_eq!(check(&stranger, refused), Err(Code::Unauthenticated), "{refused:?}");
        }
        assert_eq!(check(&stranger, Some(&shown)), Ok(()));
        assert_eq!(check(&first, None), Ok(()));

        access.deny(Denied { certificates: [Fingerprint([1; 32])].into(), token: false });
        assert_eq!(check(&first, None), Err(Code::PermissionDenied));
        assert_eq!(check(&first, Some(&shown)), Err(Code::PermissionDenied), "the token does not help it");
        assert_eq!(check(&second, None), Ok(()));
        assert_eq!(check(&stranger, Some(&shown)), Ok(()));
        access.deny(Denied { certificates: [].into(), token: true });
        assert_eq!(check(&first, None), Ok(()), "not on the list any more");
        assert_eq!(check(&stranger, Some(&shown)), Err(Code::PermissionDenied));
    }

    #[tokio::test]
    async fn without_a_token_only_certificates_let_in_and_plain_text_needs_nothing() {
        let only = access(Requirement::Credential(None));
        let zeros = format!("Bearer {}", Token::new([0; 32]).reveal());
        assert!(only.check(&connection(&only, None), Some(&zeros)).is_err());
        assert!(only.check(&connection(&only, Some(Fingerprint([1; 32]))), None).is_ok());
        let plain = access(Requirement::Nothing);
        assert!(plain.check(&connection(&plain, None), None).is_ok());
    }
}

//! Principals: who answers for what a worker does.

use std::fmt;
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr};
use std::str::FromStr;

use crate::{Fingerprint, WorkerId};

/// Who answers for what a worker does. A worker may take any id and any number of them; what it cannot choose is the
/// credential that it shows and the address that it calls from. All workers of one principal have one vote.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Principal {
    /// The coordinator's own process.
    Coordinator,
    /// Whoever has the key of this certificate.
    Certificate(Fingerprint),
    /// Whoever shows the token, which many may have, at this origin.
    Token(Origin),
    /// Whoever calls from this origin, where no credential is required.
    Anonymous(Origin),
}

/// What one peer can hardly change: an IPv4 address, or the /64 in which it may choose any IPv6 address. All loopback
/// addresses are one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Origin(IpAddr);

impl Origin {
    /// Where this address belongs.
    pub fn of(address: IpAddr) -> Self {
        Self(match address.to_canonical() {
            address if address.is_loopback() => Ipv4Addr::LOCALHOST.into(),
            IpAddr::V6(address) => {
                let [a, b, c, d, ..] = address.segments();
                Ipv6Addr::new(a, b, c, d, 0, 0, 0, 0).into()
            }
            v4 => v4,
        })
    }
}

impl Principal {
    /// Its credential, without the secret: what an operator writes on the deny list. `None` where none is required.
    pub fn credential(&self) -> Option<String> {
        match self {
            Self::Coordinator | Self::Anonymous(_) => None,
            Self::Certificate(fingerprint) => Some(format!("certificate {fingerprint}")),
            Self::Token(_) => Some("token".to_owned()),
        }
    }
}

impl fmt::Display for Origin {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

impl fmt::Display for Principal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Coordinator => f.write_str("coordinator"),
            Self::Certificate(fingerprint) => write!(f, "certificate {fingerprint}"),
            Self::Token(origin) => write!(f, "token {origin}"),
            Self::Anonymous(origin) => write!(f, "address {origin}"),
        }
    }
}

/// A text that names no principal.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "principal: must be `certificate FINGERPRINT`, `token ADDRESS` or `address ADDRESS`, got {0:?}\ncopy it from the column `principal` of the table `workers`"
)]
pub struct InvalidPrincipal(String);

impl FromStr for Principal {
    type Err = InvalidPrincipal;

    fn from_str(text: &str) -> Result<Self, InvalidPrincipal> {
        let origin = |address: &str| address.parse().ok().map(Origin::of);
        match text.split_once(' ') {
            None if text == "coordinator" => Some(Self::Coordinator),
            Some(("certificate", fingerprint)) => fingerprint.parse().ok().map(Self::Certificate),
            Some(("token", address)) => origin(address).map(Self::Token),
            Some(("address", address)) => origin(address).map(Self::Anonymous),
            _ => None,
        }
        .ok_or_else(|| InvalidPrincipal(crate::truncate(text, 100).to_owned()))
    }
}

/// 32 random bytes by which a worker proves that an id is its own: the id is their digest, so that whoever has read it in
/// a table or a log cannot speak in its name.
#[derive(Clone)]
pub struct WorkerSecret([u8; 32]);

impl WorkerSecret {
    /// A secret of these bytes, which must be random.
    pub fn new(bytes: [u8; 32]) -> Self {
        Self(bytes)
    }

    /// The id that it proves.
    pub fn id(&self) -> WorkerId {
        let mut id = [0; 16];
        id.copy_from_slice(&blake3::derive_key("descry worker id v1", &self.0)[..16]);
        WorkerId(id)
    }

    /// As it travels in messages: for these only.
    pub fn reveal(&self) -> Vec<u8> {
        self.0.to_vec()
    }
}

impl TryFrom<&[u8]> for WorkerSecret {
    type Error = std::array::TryFromSliceError;

    fn try_from(bytes: &[u8]) -> Result<Self, Self::Error> {
        bytes.try_into().map(Self)
    }
}

impl fmt::Debug for WorkerSecret {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("WorkerSecret(…)")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn origin(text: &str) -> Origin {
        Origin::of(text.parse().unwrap())
    }

    #[test]
    fn what_a_peer_can_choose_is_no_other_origin() {
        for loopback in ["127.0.0.1", "127.3.2.1", "::1", "::ffff:127.0.0.9"] {
            assert_eq!(origin(loopback), origin("127.0.0.1"), "{loopback}");
        }
        assert_eq!(origin("2001:db8:1:2::7"), origin("2001:db8:1:2:ffff::"));
        assert_ne!(origin("2001:db8:1:2::7"), origin("2001:db8:1:3::7"));
        assert_eq!(origin("::ffff:192.0.2.7"), origin("192.0.2.7"));
        assert_ne!(origin("192.0.2.7"), origin("192.0.2.8"));
    }

    #[test]
    fn a_principal_reads_back_from_its_text() {
        let principals = [
            Principal::Coordinator,
            Principal::Certificate(Fingerprint([0xab; 32])),
            Principal::Token(origin("2001:db8::1")),
            Principal::Anonymous(origin("192.0.2.7")),
        ];
        for principal in principals {
            assert_eq!(principal.to_string().parse(), Ok(principal));
        }
        for wrong in
            ["", "token", "token x", "certificate 12", "address 192.0.2", "coordinator x", "Token 192.0.2.7"]
        {
            let error = wrong.parse::<Principal>().unwrap_err().to_string();
            assert!(error.starts_with("principal: must be") && error.contains('\n'), "{error}");
        }
    }

    #[test]
    fn a_secret_proves_one_id_and_is_not_shown() {
        let secret = WorkerSecret::new([7; 32]);
        assert_eq!(secret.id(), WorkerSecret::try_from(&secret.reveal()[..]).unwrap().id());
        assert_ne!(secret.id(), WorkerSecret::new([8; 32]).id());
        assert!(WorkerSecret::try_from(&[7; 31][..]).is_err());
        assert_eq!(format!("{secret:?}"), "WorkerSecret(…)");
    }
}

//! The join address: the one string that a worker needs, and the secrets that may be in it.

use std::fmt;
use std::net::Ipv6Addr;
use std::str::FromStr;

use crate::Fingerprint;

/// The coordinator's port unless an address names another.
pub const DEFAULT_PORT: u16 = 7700;

/// The longest part of a host's name between two dots, bytes (RFC 1035).
const MAX_LABEL_BYTES: usize = 63;

/// Where a coordinator is, and how to know that it is the right one:
/// `http://HOST:PORT`, or `https://HOST:PORT#ca=FINGERPRINT&token=TOKEN`, the token being optional.
///
/// Its `Display` leaves out what follows `#`, its `Debug` the token: only [`JoinAddress::reveal`] shows everything.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct JoinAddress {
    /// A name or an IP address, without brackets.
    pub host: String,
    /// The port.
    pub port: u16,
    /// `None`: plain text.
    pub trust: Option<Trust>,
}

/// What makes a connection trustworthy, to both sides.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Trust {
    /// Of the only CA whose certificates the coordinator may show.
    pub ca: Fingerprint,
    /// What the worker shows unless it has a certificate.
    pub token: Option<Token>,
}

/// A text that is no join address.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "join address: {what}, got {got}\nwrite it like http://192.0.2.7:{DEFAULT_PORT}, or take the address that `coordinator certs` has made"
)]
pub struct InvalidJoinAddress {
    what: &'static str,
    got: String,
}

impl JoinAddress {
    /// The whole address with its token: for files and terminals of those who may join, never for logs.
    pub fn reveal(&self) -> String {
        let mut text = self.to_string();
        if let Some(Trust { ca, token }) = &self.trust {
            text.push_str(&format!("#ca={ca}"));
            if let Some(token) = token {
                text.push_str("&token=");
                text.push_str(&token.reveal());
            }
        }
        text
    }
}

impl fmt::Display for JoinAddress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let scheme = if self.trust.is_some() { "https" } else { "http" };
        let Self { host, port, .. } = self;
        if host.contains(':') {
            write!(f, "{scheme}://[{host}]:{port}")
        } else {
            write!(f, "{scheme}://{host}:{port}")
        }
    }
}

impl FromStr for JoinAddress {
    type Err = InvalidJoinAddress;

    /// Also accepts an address without `http://`, and adds the usual port.
    fn from_str(text: &str) -> Result<Self, InvalidJoinAddress> {
        let wrong = |what| InvalidJoinAddress { what, got: without_secrets(text) };
        let (address, fragment) = text.split_once('#').map_or((text, None), |(a, b)| (a, Some(b)));
        let (scheme, authority) = address.split_once("://").unwrap_or(("http", address));
        let authority = authority.strip_suffix('/').unwrap_or(authority);
        let (host, port) = host_and_port(authority).map_err(wrong)?;
        let trust = match (scheme, fragment) {
            ("http", None) => None,
            ("http", Some(_)) => {
                return Err(wrong("a fingerprint and a token need https://, which they travel over"));
            }
            ("https", None) => return Err(wrong("https:// needs the fingerprint of its CA, #ca=…")),
            ("https", Some(fragment)) => Some(trust(fragment).map_err(wrong)?),
            _ => return Err(wrong("must begin with http:// or https://")),
        };
        Ok(Self { host, port, trust })
    }
}

fn host_and_port(authority: &str) -> Result<(String, u16), &'static str> {
    let (host, port) = match authority.strip_prefix('[') {
        Some(rest) => {
            let (host, port) = rest.split_once(']').ok_or("must close the bracket of its host")?;
            host.parse::<Ipv6Addr>().map_err(|_| "must have an IPv6 address between brackets")?;
            (host, port)
        }
        None => authority.find(':').map_or((authority, ""), |colon| authority.split_at(colon)),
    };
    let label = |label: &str| {
        let plain = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
        (1..=MAX_LABEL_BYTES).contains(&label.len()) && label.chars().all(plain)
    };
    if host.is_empty() {
        return Err("must name a host");
    }
    if !host.contains(':') && !host.trim_end_matches('.').split('.').all(label) {
        return Err("must be a host and a port only");
    }
    let port = match port.strip_prefix(':').map(str::parse) {
        None if port.is_empty() => DEFAULT_PORT,
        Some(Ok(port)) if port > 0 => port,
        _ => return Err("port must be a number from 1 to 65535"),
    };
    Ok((host.to_owned(), port))
}

fn trust(fragment: &str) -> Result<Trust, &'static str> {
    let (mut ca, mut token) = (None, None);
    for part in fragment.split('&') {
        let fresh = match part.split_once('=') {
            Some(("ca", value)) => {
                ca.replace(value.parse().map_err(|_| "ca must be a fingerprint of 64 hex digits")?).is_none()
            }
            Some(("token", value)) => {
                token.replace(value.parse().map_err(|_| "token must be 64 hex digits")?).is_none()
            }
            _ => return Err("after # there must be ca=… and perhaps &token=…"),
        };
        if !fresh {
            return Err("after # each part must stand once");
        }
    }
    Ok(Trust { ca: ca.ok_or("https:// needs the fingerprint of its CA, #ca=…")?, token })
}

/// What of a wrong address may be shown: nothing that could be a token in the wrong place.
fn without_secrets(text: &str) -> String {
    let public = text.find(['#', '?', '@', '&', '=']).unwrap_or(text.len());
    let public = crate::truncate(&text[..public], 255);
    let long = public.split(|c: char| !c.is_ascii_alphanumeric()).any(|word| word.len() > MAX_LABEL_BYTES);
    let public: String = public.chars().filter(|c| !c.is_control()).collect();
    match (long, public.len() < text.len()) {
        (true, _) => "what is too long to be shown safely".to_owned(),
        (false, true) => format!("{public}…"),
        (false, false) => public,
    }
}

/// 32 random bytes that let a worker in. Never shown but by [`Token::reveal`].
#[derive(Clone)]
pub struct Token([u8; 32]);

impl Token {
    /// A token of these bytes, which must be random.
    pub fn new(bytes: [u8; 32]) -> Self {
        Self(bytes)
    }

    /// As 64 hex digits.
    pub fn reveal(&self) -> String {
        crate::ids::hex(&self.0)
    }
}

/// A text that is no token. It is not shown: it may be nearly one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("token: must be 64 hex digits\ncopy it again, whole")]
pub struct InvalidToken;

impl FromStr for Token {
    type Err = InvalidToken;

    fn from_str(text: &str) -> Result<Self, InvalidToken> {
        crate::ids::parse_hex(text).map(Self).ok_or(InvalidToken)
    }
}

impl PartialEq for Token {
    /// In constant time: how long it takes tells nothing of where two tokens differ.
    fn eq(&self, other: &Self) -> bool {
        blake3::Hash::from_bytes(self.0) == blake3::Hash::from_bytes(other.0)
    }
}

impl Eq for Token {}

impl fmt::Debug for Token {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Token(…)")
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const CA: &str = "00112233445566778899aabbccddeeff00112233445566778899aabbccddeeff";
    const TOKEN: &str = "ffeeddccbbaa99887766554433221100ffeeddccbbaa99887766554433221100";

    #[test]
    fn addresses_are_hosts_and_ports() {
        for (address, expected) in [
            ("http://192.0.2.7:7701", "http://192.0.2.7:7701"),
            ("gpu-host", "http://gpu-host:7700"),
            ("http://gpu-host/", "http://gpu-host:7700"),
            ("[::1]:80", "http://[::1]:80"),
        ] {
            assert_eq!(address.parse::<JoinAddress>().unwrap().reveal(), expected);
        }
        let whole = format!("https://gpu-host:7700#ca={CA}&token={TOKEN}");
        let address: JoinAddress = whole.parse().unwrap();
        assert_eq!(address.reveal(), whole);
        assert_eq!(address.to_string(), "https://gpu-host:7700");
        assert!(!format!("{address:?}").contains(&TOKEN[..8]), "{address:?}");
        assert_eq!(address, format!("https://gpu-host/#token={TOKEN}&ca={CA}").parse().unwrap());
    }

    #[test]
    fn wrong_addresses_say_why_and_show_no_token() {
        for address in [
            "",
            "http://",
            "ht tp://x",
            "ftp://x",
            "https://x",
            "https://x#",
            "x:99999",
            "x:port",
            "x:0",
            "x:",
            "[::1",
            "[x]:1",
            "http://x/path",
            "http://x?y",
            "user@x:1@y",
            TOKEN,
            &format!("x?token={TOKEN}"),
            &format!("http://x#token={TOKEN}"),
            &format!("https://x#token={TOKEN}"),
            &format!("https://x#ca={CA}&token={}", &TOKEN[1..]),
            &format!("https://x#ca={CA}&ca={CA}"),
            &format!("https://x&token={TOKEN}#ca={CA}"),
        ] {
            let error = address.parse::<JoinAddress>().unwrap_err().to_string();
            assert!(error.starts_with("join address: ") && error.contains("\nwrite it like"), "{error}");
            assert!(!error.contains(&TOKEN[32..]), "{error}");
        }
    }

    #[test]
    fn tokens_are_equal_in_all_bytes_or_not_at_all() {
        let token: Token = TOKEN.parse().unwrap();
        assert_eq!(token, TOKEN.to_uppercase().parse().unwrap());
        for byte in 0..32 {
            let mut other = token.clone();
            other.0[byte] ^= 1;
            assert_ne!(token, other);
        }
    }

    proptest! {
        #[test]
        fn any_text_is_an_address_or_an_error(text in "(https?://)?[a-z0-9.:/#&=\\[\\]@?é-]{0,80}|\\PC*") {
            if let Ok(address) = text.parse::<JoinAddress>() {
                prop_assert_eq!(address.reveal().parse(), Ok(address));
            }
        }

        #[test]
        fn addresses_survive_writing_and_reading(
            host in "[a-z0-9][a-z0-9_-]{0,20}(\\.[a-z0-9]{1,9}){0,3}",
            port in 1u16..,
            ca: [u8; 32],
            token: Option<[u8; 32]>,
            encrypted: bool,
        ) {
            let trust = Trust { ca: Fingerprint(ca), token: token.map(Token::new) };
            let address = JoinAddress { host, port, trust: encrypted.then_some(trust) };
            prop_assert_eq!(address.reveal().parse(), Ok(address));
        }
    }
}

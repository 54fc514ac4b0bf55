//! Who may look, and who may act: what a request has to show, and from which page it may come.

use std::net::SocketAddr;
use std::sync::Arc;

use axum::extract::Request;
use axum::http::header::{AUTHORIZATION, COOKIE, HOST, ORIGIN};
use axum::http::{HeaderMap, HeaderValue, Method, StatusCode};
use transport::WebTokens;

use super::peer::Peer;

/// Name of the cookie that has a token.
const COOKIE_NAME: &str = "descry-dashboard";
/// Sent with every answer: the page loads nothing from elsewhere and stands in no other page.
const HEADERS: [(&str, &str); 6] = [
    (
        "content-security-policy",
        "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; img-src 'self' data: blob:; \
         base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    ),
    ("x-content-type-options", "nosniff"),
    ("x-frame-options", "DENY"),
    ("referrer-policy", "no-referrer"),
    ("cross-origin-opener-policy", "same-origin"),
    ("cross-origin-resource-policy", "same-origin"),
];

/// What a request may do.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Right {
    /// Fetch the page, which asks for a token.
    Page,
    /// Look.
    View,
    /// Act.
    Control,
}

/// Access to an address.
pub struct Access {
    /// `None`: nothing has to be shown.
    tokens: Option<WebTokens>,
    is_loopback: bool,
    port: u16,
}

/// Why a request is refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Refusal {
    /// It names another host: a page of elsewhere whose name leads here.
    Host,
    /// It comes from another page.
    Origin,
    /// It shows no token, or one that does not allow it.
    Token,
}

impl Refusal {
    /// Its status and what is to be done.
    pub fn text(self) -> (StatusCode, &'static str) {
        match self {
            Self::Host => (
                StatusCode::FORBIDDEN,
                "host: another name than this machine's\nopen the address that the program has printed",
            ),
            Self::Origin => (StatusCode::FORBIDDEN, "origin: another page\nuse the page of this address"),
            Self::Token => (
                StatusCode::UNAUTHORIZED,
                "token: none, or one that does not allow this\nenter the token of the folder of certificates",
            ),
        }
    }
}

impl Access {
    /// To what is served at this address.
    pub fn new(address: SocketAddr, tokens: Option<WebTokens>) -> Self {
        Self { tokens, is_loopback: address.ip().is_loopback(), port: address.port() }
    }

    /// What a request may do; where that is more than to fetch the page, its connection is let in.
    ///
    /// # Errors
    /// If it comes from elsewhere, whatever it shows.
    pub fn admit(&self, request: &Request) -> Result<Right, Refusal> {
        let authority = request.uri().authority().map(|authority| authority.as_str());
        let right = self.check(request.method(), request.headers(), authority)?;
        if right > Right::Page
            && let Some(peer) = request.extensions().get::<Arc<Peer>>()
        {
            peer.let_in();
        }
        Ok(right)
    }

    fn check(&self, method: &Method, headers: &HeaderMap, authority: Option<&str>) -> Result<Right, Refusal> {
        let host =
            headers.get(HOST).and_then(|host| host.to_str().ok()).or(authority).ok_or(Refusal::Host)?;
        // A name that leads to this machine is no proof: its owner can let it lead here.
        if self.is_loopback && !self.is_this_machine(host) {
            return Err(Refusal::Host);
        }
        let site = headers.get("sec-fetch-site").and_then(|site| site.to_str().ok());
        match headers.get(ORIGIN) {
            Some(origin) if !is_same(origin, host) => return Err(Refusal::Origin),
            Some(_) => {}
            None if *method != Method::GET => return Err(Refusal::Origin),
            None => {}
        }
        let is_navigation = headers.get("sec-fetch-mode").is_some_and(|mode| mode == "navigate");
        if matches!(site, Some("cross-site" | "same-site")) && !is_navigation {
            return Err(Refusal::Origin);
        }
        Ok(self.right(headers))
    }

    fn is_this_machine(&self, host: &str) -> bool {
        let names = ["localhost", "127.0.0.1", "[::1]"];
        let is_named = |name: &&str| host.strip_prefix(*name).is_some_and(|rest| self.is_port(rest));
        names.iter().any(is_named)
            || host
                .parse::<SocketAddr>()
                .is_ok_and(|host| host.ip().is_loopback() && host.port() == self.port)
    }

    fn is_port(&self, rest: &str) -> bool {
        match rest.strip_prefix(':') {
            Some(port) => port.parse() == Ok(self.port),
            None => rest.is_empty() && self.port == 80,
        }
    }

    fn right(&self, headers: &HeaderMap) -> Right {
        let Some(tokens) = &self.tokens else { return Right::Control };
        let bearer =
            headers.get(AUTHORIZATION).and_then(|value| value.to_str().ok()?.strip_prefix("Bearer "));
        let cookies = headers.get_all(COOKIE).iter().filter_map(|value| value.to_str().ok());
        let cookies = cookies.flat_map(|cookies| cookies.split(';')).filter_map(|cookie| {
            let (name, value) = cookie.trim().split_once('=')?;
            (name == COOKIE_NAME).then_some(value)
        });
        let rights = bearer.into_iter().chain(cookies).map(|shown| right_of(tokens, shown));
        rights.max().unwrap_or(Right::Page)
    }

    /// The cookie that keeps a token, if it is one.
    pub fn cookie(&self, token: &str) -> Option<HeaderValue> {
        let tokens = self.tokens.as_ref()?;
        let token = token.trim();
        if right_of(tokens, token) == Right::Page {
            return None;
        }
        HeaderValue::from_str(&format!("{COOKIE_NAME}={token}; Path=/; HttpOnly; Secure; SameSite=Strict"))
            .ok()
    }
}

fn right_of(tokens: &WebTokens, shown: &str) -> Right {
    match shown.parse::<proto::Token>() {
        Ok(token) if token == tokens.control => Right::Control,
        Ok(token) if token == tokens.view => Right::View,
        _ => Right::Page,
    }
}

/// Whether a page is of this host, over either protocol: the port is one or the other.
fn is_same(origin: &HeaderValue, host: &str) -> bool {
    let origin = origin.to_str().unwrap_or_default();
    ["http://", "https://"].iter().any(|scheme| origin.strip_prefix(scheme) == Some(host))
}

/// Adds what protects the page to an answer's headers.
pub fn protect(headers: &mut HeaderMap) {
    for (name, value) in HEADERS {
        headers.insert(name, HeaderValue::from_static(value));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tokens() -> WebTokens {
        let token = |byte| proto::Token::new([byte; 32]);
        WebTokens { view: token(1), control: token(2), folder: "tls".into() }
    }

    fn headers(values: &[(&'static str, &str)]) -> HeaderMap {
        values.iter().map(|(name, value)| (name.parse().unwrap(), value.parse().unwrap())).collect()
    }

    fn check(access: &Access, method: Method, values: &[(&'static str, &str)]) -> Result<Right, Refusal> {
        access.check(&method, &headers(values), None)
    }

    #[test]
    fn on_this_machine_only_its_own_names_and_pages_are_let_in() {
        let access = Access::new("127.0.0.1:7780".parse().unwrap(), None);
        let get = |values: &[(&'static str, &str)]| check(&access, Method::GET, values);
        let post = |values: &[(&'static str, &str)]| check(&access, Method::POST, values);
        for host in ["127.0.0.1:7780", "localhost:7780", "[::1]:7780", "127.0.0.2:7780"] {
            assert_eq!(get(&[("host", host)]), Ok(Right::Control), "{host}");
            let origin = format!("http://{host}");
            assert_eq!(post(&[("host", host), ("origin", &origin)]), Ok(Right::Control), "{host}");
        }
        for host in [
            "evil.example:7780",
            "localhost.evil.example:7780",
            "localhost:1",
            "127.0.0.1",
            "192.0.2.1:7780",
            "",
        ] {
            assert_eq!(get(&[("host", host)]), Err(Refusal::Host), "{host}");
        }
        assert_eq!(get(&[]), Err(Refusal::Host));
        let host = ("host", "localhost:7780");
        assert_eq!(post(&[host]), Err(Refusal::Origin));
        for origin in
            ["http://evil.example", "null", "http://localhost:7781", "http://localhost:7780.evil.example"]
        {
            assert_eq!(get(&[host, ("origin", origin)]), Err(Refusal::Origin), "{origin}");
            assert_eq!(post(&[host, ("origin", origin)]), Err(Refusal::Origin), "{origin}");
        }
        assert_eq!(get(&[host, ("sec-fetch-site", "cross-site")]), Err(Refusal::Origin));
        let link = [host, ("sec-fetch-site", "cross-site"), ("sec-fetch-mode", "navigate")];
        assert_eq!(get(&link), Ok(Right::Control), "a link to the page");
    }

    #[test]
    fn elsewhere_a_token_says_what_is_allowed() {
        let access = Access::new("192.0.2.1:7780".parse().unwrap(), Some(tokens()));
        let right = |values: &[(&'static str, &str)]| {
            check(&access, Method::GET, &[&[("host", "gpu-host:7780")], values].concat()).unwrap()
        };
        let [view, control, other] = [1u8, 2, 3].map(|byte| proto::Token::new([byte; 32]).reveal());
        assert_eq!(right(&[]), Right::Page);
        for (token, allowed) in [(&view, Right::View), (&control, Right::Control), (&other, Right::Page)] {
            assert_eq!(right(&[("authorization", &format!("Bearer {token}"))]), allowed);
            assert_eq!(right(&[("cookie", &format!("a=b; descry-dashboard={token}"))]), allowed);
            let cookie = access.cookie(token);
            assert_eq!(cookie.is_some(), allowed > Right::Page);
            if let Some(cookie) = cookie {
                let cookie = cookie.to_str().unwrap();
                assert!(cookie.ends_with("; HttpOnly; Secure; SameSite=Strict"), "{cookie}");
            }
        }
        assert_eq!(right(&[("cookie", &format!("other={control}"))]), Right::Page);
    }
}

//! Access control: Host and Origin checks, and roles of tokens.
//!
//! A page of another site cannot reach the service through the user's browser. An address that other machines reach
//! needs a token.

use super::App;
use super::config::{Config, Role};
use super::problem::{Kind, Problem};
use axum::extract::{Request, State};
use axum::http::{HeaderMap, HeaderName, HeaderValue, Method, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use nacre_capture::session::sha256;
use std::sync::Arc;

/// Refuses requests from other origins and without the needed role, and adds security headers to the response.
pub async fn check(State(app): State<Arc<App>>, request: Request, next: Next) -> Response {
    let path = request.uri().path();
    let (method, headers, config) = (request.method(), request.headers(), app.config());
    let result = allowed_here(&config, method, path, headers).and_then(|()| allowed_to(&config, method, path, headers));
    let mut response = match result {
        Ok(()) => next.run(request).await,
        Err(problem) => problem.into_response(),
    };
    let headers = response.headers_mut();
    for (name, value) in [
        (header::CONTENT_SECURITY_POLICY, nacre_web::POLICY),
        (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
        (header::REFERRER_POLICY, "no-referrer"),
        (header::X_FRAME_OPTIONS, "DENY"),
    ] {
        headers.insert(name, HeaderValue::from_static(value));
    }
    headers.entry(header::CACHE_CONTROL).or_insert(HeaderValue::from_static("no-store"));
    response
}

/// Checks Host and Origin of a request.
///
/// The Host must be one of our names, since a foreign name can point here by DNS rebinding. The same holds for the
/// Origin, where there is one. Requests that change state must come from our own page.
fn allowed_here(config: &Config, method: &Method, path: &str, headers: &HeaderMap) -> Result<(), Problem> {
    let Some(host) = text(headers, &header::HOST).next() else {
        return Err(Problem::bad("the Host header is missing"));
    };
    if !is_ours(config, host) {
        return Err(Problem::new(Kind::Forbidden, "the Host header names another host")
            .remedy("add the name to hosts in the configuration"));
    }
    let changes = needed(method, path) > Role::View || !is_safe(method);
    let from_here = |origin: &str| match Address::of_origin(origin) {
        Some(origin) if changes => origin.is_page_of(config, host),
        Some(origin) => is_ours(config, &origin.host),
        None => false,
    };
    let site = |site: &str| matches!(site, "same-origin" | "none") || (!changes && site == "same-site");
    let sites = HeaderName::from_static("sec-fetch-site");
    if text(headers, &header::ORIGIN).all(from_here) && text(headers, &sites).all(site) {
        return Ok(());
    }
    Err(Problem::new(Kind::Forbidden, "the request comes from a page elsewhere").remedy(
        "use the page of the service; behind a proxy, add the address of its page (https://NAME:PORT) to hosts in the configuration",
    ))
}

/// Values of a header; a value that is not text reads as "?", which is invalid everywhere.
fn text<'a>(headers: &'a HeaderMap, name: &HeaderName) -> impl Iterator<Item = &'a str> {
    headers.get_all(name).into_iter().map(|value| value.to_str().unwrap_or("?"))
}

/// Whether the method is one that changes no state (RFC 9110, section 9.2.1).
fn is_safe(method: &Method) -> bool {
    matches!(*method, Method::GET | Method::HEAD | Method::OPTIONS)
}

/// Address of a page: scheme, host and port.
#[derive(PartialEq)]
pub struct Address {
    https: bool,
    /// Lower case; IPv6 addresses in brackets.
    host: String,
    port: u16,
}

impl Address {
    /// Reads `http://NAME:PORT` or `https://NAME:PORT`. Default of the port: that of the scheme.
    pub fn of_origin(origin: &str) -> Option<Self> {
        let (scheme, host) = origin.split_once("://")?;
        match scheme {
            "http" => Self::new(false, host),
            "https" => Self::new(true, host),
            _ => None,
        }
    }

    fn new(https: bool, host: &str) -> Option<Self> {
        let usual = if https { 443 } else { 80 };
        let (name, port) = match host.rsplit_once(':') {
            Some((name, port)) if !port.ends_with(']') => (name, port.parse().ok()?),
            _ => (host, usual),
        };
        let plain = |c: char| c.is_alphanumeric() || ".-_:[]".contains(c);
        (!name.is_empty() && name.chars().all(plain)).then(|| Self { https, host: name.to_ascii_lowercase(), port })
    }

    /// Whether requests to `host` from a page of this address are those of our own page.
    ///
    /// The service itself speaks HTTP. Configured names may belong to a proxy, which may speak HTTPS and pass on
    /// another Host than the browser's.
    fn is_page_of(&self, config: &Config, host: &str) -> bool {
        let Some(here) = Self::new(self.https, host) else { return false };
        let named = config.hosts.iter().any(|name| name.eq_ignore_ascii_case(&self.host));
        let usual_port = self.port == if self.https { 443 } else { 80 };
        let proxied = named && usual_port && here.host != self.host;
        let same = here == *self && (named || !self.https);
        same || proxied || config.hosts.iter().any(|page| Self::of_origin(page).as_ref() == Some(self))
    }
}

fn is_ours(config: &Config, name: &str) -> bool {
    // Behind a forwarded port the port differs. DNS rebinding has to forge the name, so only the name is compared.
    let host = match name.rsplit_once(':') {
        Some((host, port)) if port.bytes().all(|b| b.is_ascii_digit()) && !port.is_empty() => host,
        _ => name,
    };
    let of_page = |h: &str| Address::of_origin(h).is_some_and(|page| page.host.eq_ignore_ascii_case(host));
    if config.hosts.iter().any(|h| h.eq_ignore_ascii_case(host) || of_page(h)) {
        return true;
    }
    let host = host.trim_start_matches('[').trim_end_matches(']').to_ascii_lowercase();
    let address: Option<std::net::IpAddr> = host.parse().ok();
    let listens =
        address.is_some_and(|ip| ip == config.listen.ip() || (ip.is_loopback() && config.listen.ip().is_loopback()));
    // A service on all interfaces accepts any IP address as its name, but no foreign name.
    let any = address.is_some() && config.listen.ip().is_unspecified();
    host == "localhost" || listens || any
}

/// The role that a request needs.
fn needed(method: &Method, path: &str) -> Role {
    match *method {
        // The configuration names folders, devices and hashes of tokens.
        _ if path.starts_with("/api/v1/settings") => Role::Administer,
        // Renaming and restoring need the same role as deleting.
        Method::DELETE | Method::PATCH => Role::Administer,
        Method::POST if path.starts_with("/api/v1/trash/") => Role::Administer,
        // The request reads, but binds the pattern page.
        _ if path == "/api/v1/display/link" => Role::Operate,
        _ if is_safe(method) => Role::View,
        // Anyone who sees danger may stop the bench.
        _ if path == "/api/v1/stop" => Role::View,
        _ => Role::Operate,
    }
}

fn allowed_to(config: &Config, method: &Method, path: &str, headers: &HeaderMap) -> Result<(), Problem> {
    // The page holds no secret and asks for the token; health checks are for machines.
    let open = !path.starts_with("/api/") && path != "/metrics";
    if open || (config.tokens.is_empty() && config.listen.ip().is_loopback()) {
        return Ok(());
    }
    let given =
        headers.get(header::AUTHORIZATION).and_then(|v| v.to_str().ok()).and_then(|v| v.strip_prefix("Bearer "));
    let Some(given) = given else {
        return Err(Problem::new(Kind::Unauthorized, "no token").remedy("send Authorization: Bearer TOKEN"));
    };
    let hash = sha256(given.as_bytes());
    // Comparison time reveals nothing about the token: hashes of random tokens are compared.
    let Some(token) = config.tokens.iter().find(|t| t.sha256.eq_ignore_ascii_case(&hash)) else {
        return Err(Problem::new(Kind::Unauthorized, "the token is not known").remedy("`nacre token` makes one"));
    };
    if token.role < needed(method, path) {
        let detail = format!("{} may not do this", token.name);
        return Err(Problem::new(Kind::Forbidden, detail).remedy("use a token of a higher role"));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn headers(list: &[(&'static str, &str)]) -> HeaderMap {
        list.iter().map(|(k, v)| (header::HeaderName::from_static(k), v.parse().unwrap())).collect()
    }

    #[test]
    fn only_our_own_names_and_pages_are_served() {
        let config = Config { hosts: vec!["bench.lab".into()], ..Config::default() };
        for (list, ok) in [
            (&[("host", "localhost:8465")][..], true),
            (&[("host", "127.0.0.1")], true),
            (&[("host", "[::1]:8465")], true),
            (&[("host", "bench.lab:80"), ("origin", "http://bench.lab:80")], true),
            (&[("host", "localhost"), ("origin", "http://localhost:3000")], true),
            (&[("host", "localhost"), ("sec-fetch-site", "same-site")], true),
            (&[("host", "evil.example")], false),
            (&[("host", "127.0.0.1.evil.example")], false),
            (&[("host", "localhost"), ("origin", "https://evil.example")], false),
            (&[("host", "localhost"), ("origin", "null")], false),
            (&[("host", "localhost"), ("sec-fetch-site", "cross-site")], false),
            (&[], false),
        ] {
            let allowed = allowed_here(&config, &Method::GET, "/api/v1/devices", &headers(list));
            assert_eq!(allowed.is_ok(), ok, "{list:?}");
        }
    }

    #[test]
    fn only_our_own_page_changes_anything() {
        let hosts = ["bench.lab", "https://proxy.lab", "https://other.lab:8443"].map(Into::into).into();
        let config = Config { hosts, ..Config::default() };
        for (host, origin, site, ok) in [
            ("localhost:8465", "", "", true),
            ("localhost:8465", "http://localhost:8465", "same-origin", true),
            ("LOCALHOST:8465", "http://localhost:8465", "", true),
            ("localhost:8465", "", "none", true),
            ("[::1]:8465", "http://[::1]:8465", "", true),
            // A forwarded port.
            ("localhost:9000", "http://localhost:9000", "same-origin", true),
            ("localhost", "http://localhost", "", true),
            // Proxies that keep the Host, and proxies that replace it.
            ("bench.lab", "https://bench.lab", "same-origin", true),
            ("bench.lab:8443", "https://bench.lab:8443", "", true),
            ("127.0.0.1:8465", "https://bench.lab", "same-origin", true),
            ("127.0.0.1:8465", "https://proxy.lab", "same-origin", true),
            ("127.0.0.1:8465", "https://other.lab:8443", "", true),
            ("localhost:8465", "http://localhost:3000", "", false),
            ("localhost:8465", "http://localhost", "", false),
            ("localhost:8465", "https://localhost:8465", "", false),
            ("localhost:8465", "http://127.0.0.1:8465", "", false),
            ("localhost:8465", "", "same-site", false),
            ("localhost:8465", "http://localhost:8465", "same-site", false),
            ("localhost:8465", "null", "", false),
            ("bench.lab:80", "http://bench.lab:3000", "", false),
            ("bench.lab", "https://bench.lab:3000", "", false),
            ("bench.lab:8465", "http://bench.lab", "", false),
            ("127.0.0.1:8465", "https://bench.lab", "cross-site", false),
            ("127.0.0.1:8465", "https://bench.lab:3000", "", false),
            ("127.0.0.1:8465", "http://proxy.lab", "", false),
            ("127.0.0.1:8465", "https://proxy.lab:8443", "", false),
            ("localhost:8465", "http://localhost:8465/", "", false),
            ("localhost:8465", "ftp://localhost:8465", "", false),
        ] {
            let all = [("host", host), ("origin", origin), ("sec-fetch-site", site)];
            let list: Vec<_> = all.into_iter().filter(|(_, value)| !value.is_empty()).collect();
            for (method, path) in [
                (Method::POST, "/api/v1/stop"),
                (Method::DELETE, "/api/v1/sessions/x"),
                (Method::GET, "/api/v1/display/link"),
            ] {
                let allowed = allowed_here(&config, &method, path, &headers(&list));
                assert_eq!(allowed.is_ok(), ok, "{method} {list:?}");
            }
        }
    }

    #[test]
    fn roles_allow_what_they_say() {
        let token = |name: &str, role| super::super::config::Token {
            name: name.into(),
            role,
            sha256: sha256(format!("secret of {name}").as_bytes()),
        };
        let config = Config {
            listen: "0.0.0.0:1".parse().unwrap(),
            tokens: vec![token("v", Role::View), token("o", Role::Operate), token("a", Role::Administer)],
            ..Config::default()
        };
        let may = |who: &str, method: Method, path: &str| {
            let bearer = format!("Bearer secret of {who}");
            allowed_to(&config, &method, path, &headers(&[("authorization", &bearer)])).is_ok()
        };
        assert!(may("v", Method::GET, "/api/v1/devices") && !may("v", Method::POST, "/api/v1/sessions"));
        assert!(may("v", Method::POST, "/api/v1/stop"));
        for method in [Method::GET, Method::HEAD] {
            assert!(!may("v", method.clone(), "/api/v1/display/link") && may("o", method, "/api/v1/display/link"));
        }
        assert!(may("o", Method::POST, "/api/v1/sessions") && !may("o", Method::DELETE, "/api/v1/sessions/x"));
        for (method, path) in [(Method::PATCH, "/api/v1/sessions/x"), (Method::POST, "/api/v1/trash/x/restore")] {
            assert!(!may("o", method.clone(), path) && may("a", method, path));
        }
        for (method, path) in [(Method::GET, "/api/v1/settings"), (Method::POST, "/api/v1/settings/check")] {
            assert!(!may("o", method.clone(), path) && may("a", method, path));
        }
        assert!(may("a", Method::DELETE, "/api/v1/sessions/x") && !may("nobody", Method::GET, "/api/v1/devices"));
        assert!(allowed_to(&config, &Method::GET, "/api/v1/devices", &headers(&[])).is_err());
        assert!(allowed_to(&config, &Method::GET, "/", &headers(&[])).is_ok());
    }
}

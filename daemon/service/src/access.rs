//! Who may do what, and from where: Host and Origin are checked, so that a page elsewhere cannot reach the service through
//! the user's browser, and addresses that others can reach need a token.

use super::App;
use super::config::{Config, Role};
use super::problem::{Kind, Problem};
use axum::extract::{Request, State};
use axum::http::{HeaderMap, HeaderValue, Method, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use nacre_capture::session::sha256;
use std::sync::Arc;

/// Refuses requests from elsewhere and without the needed role; adds the headers that tell browsers to be careful.
pub async fn check(State(app): State<Arc<App>>, request: Request, next: Next) -> Response {
    let path = request.uri().path();
    let result = allowed_here(&app.config, request.headers())
        .and_then(|()| allowed_to(&app.config, request.method(), path, request.headers()));
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

/// The Host must be a name of ours (another one points here by DNS rebinding), and so must the Origin if there is one.
fn allowed_here(config: &Config, headers: &HeaderMap) -> Result<(), Problem> {
    let text = |name| headers.get(name).map(|v: &HeaderValue| v.to_str().unwrap_or("?"));
    let Some(host) = text(header::HOST) else {
        return Err(Problem::bad("the Host header is missing"));
    };
    let ours = |name: &str| is_ours(config, name);
    if !ours(host) {
        return Err(Problem::new(Kind::Forbidden, "the Host header names another host")
            .remedy("add the name to hosts in the configuration"));
    }
    match text(header::ORIGIN) {
        Some(origin)
            if !origin.split_once("://").is_some_and(|(scheme, name)| scheme.starts_with("http") && ours(name)) =>
        {
            Err(Problem::new(Kind::Forbidden, "the request comes from a page elsewhere"))
        }
        _ if text(header::HeaderName::from_static("sec-fetch-site")) == Some("cross-site") => {
            Err(Problem::new(Kind::Forbidden, "the request comes from a page elsewhere"))
        }
        _ => Ok(()),
    }
}

fn is_ours(config: &Config, name: &str) -> bool {
    // Behind a forwarded port the port differs, and the name is what rebinding has to forge.
    let host = match name.rsplit_once(':') {
        Some((host, port)) if port.bytes().all(|b| b.is_ascii_digit()) && !port.is_empty() => host,
        _ => name,
    };
    let host = host.trim_start_matches('[').trim_end_matches(']').to_ascii_lowercase();
    let address: Option<std::net::IpAddr> = host.parse().ok();
    let listens =
        address.is_some_and(|ip| ip == config.listen.ip() || (ip.is_loopback() && config.listen.ip().is_loopback()));
    // With every interface listened on, any address of ours may be named, but no foreign name.
    let any = address.is_some() && config.listen.ip().is_unspecified();
    host == "localhost" || listens || any || config.hosts.iter().any(|h| h.eq_ignore_ascii_case(&host))
}

/// What a request needs.
fn needed(method: &Method, path: &str) -> Role {
    match *method {
        Method::DELETE => Role::Administer,
        Method::GET | Method::HEAD | Method::OPTIONS => Role::View,
        // Whoever sees danger may stop it.
        _ if path == "/api/v1/stop" => Role::View,
        _ => Role::Operate,
    }
}

fn allowed_to(config: &Config, method: &Method, path: &str, headers: &HeaderMap) -> Result<(), Problem> {
    // The page itself holds no secret, and asks for the token; health is for machines.
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
    // Hashes of random tokens may be compared in any time: nothing about the token follows from them.
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
            (&[("host", "evil.example")], false),
            (&[("host", "127.0.0.1.evil.example")], false),
            (&[("host", "localhost"), ("origin", "https://evil.example")], false),
            (&[("host", "localhost"), ("origin", "null")], false),
            (&[("host", "localhost"), ("sec-fetch-site", "cross-site")], false),
            (&[], false),
        ] {
            assert_eq!(allowed_here(&config, &headers(list)).is_ok(), ok, "{list:?}");
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
        assert!(may("o", Method::POST, "/api/v1/sessions") && !may("o", Method::DELETE, "/api/v1/sessions/x"));
        assert!(may("a", Method::DELETE, "/api/v1/sessions/x") && !may("nobody", Method::GET, "/api/v1/devices"));
        assert!(allowed_to(&config, &Method::GET, "/api/v1/devices", &headers(&[])).is_err());
        assert!(allowed_to(&config, &Method::GET, "/", &headers(&[])).is_ok());
    }
}

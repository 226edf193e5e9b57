//! The dashboard: static files inside the program, served with an ETag.
//!
//! The page reads `/api/v1` as any other client does. This module must not know anything of ours.

use axum::Router;
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use axum::routing::get;

/// A file of the page.
#[derive(Debug, Clone, Copy)]
struct Asset {
    path: &'static str,
    content_type: &'static str,
    text: &'static str,
}

const SCRIPT: &str = "text/javascript; charset=utf-8";
const PICTURE: &str = "image/svg+xml";
const STYLE: &str = "text/css; charset=utf-8";

/// Files under `page/`, each served under `/dashboard/` with the content type of its line.
macro_rules! assets {
    ($($content_type:ident: $($name:literal)+;)+) => {
        &[
            Asset {
                path: "/",
                content_type: "text/html; charset=utf-8",
                text: include_str!("page/index.html"),
            },
            $($(Asset {
                path: concat!("/dashboard/", $name),
                content_type: $content_type,
                text: include_str!(concat!("page/", $name)),
            },)+)+
        ]
    };
}

const ASSETS: &[Asset] = assets![
    PICTURE: "icon.svg";
    STYLE: "base.css" "views.css" "vendor/uPlot.min.css";
    SCRIPT: "vendor/uPlot.iife.min.js" "main.js" "shell.js" "api.js" "stream.js" "store.js" "prefs.js" "dom.js" "format.js"
        "scale.js" "plot.js" "canvas.js" "heatmap.js" "orbit.js" "sparkline.js" "lines.js" "drivetrain.js" "proof.js"
        "fleet.js" "machine.js" "signals.js" "spectra.js" "usual.js" "pictures.js" "alarms.js" "acts.js" "captures.js" "demo.js";
];

/// Gives the routes of the page.
pub fn router() -> Router {
    ASSETS.iter().fold(Router::new(), |router, asset| {
        router.route(asset.path, get(async move |headers: HeaderMap| serve(*asset, &headers)))
    })
}

/// Answers with the file, or 304 when the client holds it already.
fn serve(asset: Asset, request: &HeaderMap) -> Response {
    let etag = etag(asset.text);
    let is_held =
        request.get(header::IF_NONE_MATCH).and_then(|held| held.to_str().ok()).is_some_and(
            |held| held.split(',').any(|tag| weak(tag) == weak(&etag) || tag.trim() == "*"),
        );
    let mut response = if is_held {
        StatusCode::NOT_MODIFIED.into_response()
    } else {
        ([(header::CONTENT_TYPE, asset.content_type)], asset.text).into_response()
    };
    let headers = response.headers_mut();
    headers.insert(header::CACHE_CONTROL, const { HeaderValue::from_static("no-cache") });
    // A quoted hexadecimal number is always a valid header.
    if let Ok(etag) = HeaderValue::from_str(&etag) {
        headers.insert(header::ETAG, etag);
    }
    response
}

/// A tag without its weakness mark: a proxy that compresses adds it.
fn weak(tag: &str) -> &str {
    let tag = tag.trim();
    tag.strip_prefix("W/").unwrap_or(tag)
}

/// Quoted FNV-1a hash of the text, 64 bits: tells versions of our own files apart.
fn etag(text: &str) -> String {
    let hash = text.bytes().fold(0xcbf2_9ce4_8422_2325_u64, |hash, byte| {
        (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3)
    });
    format!("\"{hash:016x}\"")
}

#[cfg(test)]
mod tests {
    use super::*;
    use axum::body::{Body, to_bytes};
    use axum::http::Request;
    use tower::ServiceExt;

    async fn get(path: &str, etag: &str) -> Response {
        let request = Request::get(path).header(header::IF_NONE_MATCH, etag);
        router().oneshot(request.body(Body::empty()).unwrap()).await.unwrap()
    }

    #[tokio::test]
    async fn files_are_served_once_and_then_known() {
        for asset in ASSETS {
            let asset = *asset;
            let response = get(asset.path, "\"other\"").await;
            assert_eq!(response.status(), StatusCode::OK);
            assert_eq!(response.headers()[header::CONTENT_TYPE], asset.content_type);
            let etag = response.headers()[header::ETAG].to_str().unwrap().to_owned();
            let body = to_bytes(response.into_body(), usize::MAX).await.unwrap();
            assert_eq!(body, asset.text);
            for held in [etag.clone(), format!("\"x\", W/{etag}"), "*".to_owned()] {
                let response = get(asset.path, &held).await;
                assert_eq!(response.status(), StatusCode::NOT_MODIFIED, "{held}");
                assert_eq!(response.headers()[header::ETAG].to_str().unwrap(), etag);
            }
        }
    }

    #[test]
    fn fnv_1a_has_its_published_values() {
        // Fowler, Noll, Vo: test vectors of the 64-bit FNV-1a.
        assert_eq!(etag(""), "\"cbf29ce484222325\"");
        assert_eq!(etag("a"), "\"af63dc4c8601ec8c\"");
    }

    /// What was made elsewhere, and what it must be.
    const VENDORED: [(&str, &str); 2] = [
        // uPlot 1.6.32, dist of the package at the npm registry.
        (
            "/dashboard/vendor/uPlot.iife.min.js",
            "19c8d4c6ad88929a79f4ae49d6f7161566dfd0ba3d15cc495e974f787eb78f1f",
        ),
        (
            "/dashboard/vendor/uPlot.min.css",
            "df630c6a8d6f8eeaff264b50f73ce5b114f646ffd9a0bb74f049b0a00135fa04",
        ),
    ];

    fn is_ours(asset: &Asset) -> bool {
        !asset.path.contains("/vendor/")
    }

    #[test]
    fn the_page_loads_nothing_from_elsewhere_and_writes_text_only() {
        for asset in ASSETS.iter().filter(|asset| is_ours(asset)) {
            // The SVG namespace is a name, not an address.
            let text = asset.text.replace("http://www.w3.org/2000/svg", "");
            for word in [
                "http://",
                "https://",
                "@import",
                "innerHTML",
                "outerHTML",
                "insertAdjacentHTML",
                "document.write",
                "eval(",
                "new Function",
                "onclick=",
                "style=",
                "localStorage.setItem(\"rotorwatch.token\"",
            ] {
                assert!(!text.contains(word), "{} holds {word}", asset.path);
            }
        }
        let page = ASSETS[0].text;
        for script in page.split("<script").skip(1) {
            let (tag, body) = script.split_once('>').unwrap();
            assert!(tag.contains("src=\"/") && body.starts_with("</script>"), "{script}");
        }
    }

    #[test]
    fn what_was_made_elsewhere_is_what_was_published() {
        use sha2::{Digest, Sha256};
        let vendored: Vec<&Asset> = ASSETS.iter().filter(|asset| !is_ours(asset)).collect();
        assert_eq!(vendored.len(), VENDORED.len());
        for (path, sha256) in VENDORED {
            let asset = vendored.iter().find(|asset| asset.path == path).unwrap();
            let hash = Sha256::digest(asset.text);
            let hash: String = hash.iter().map(|byte| format!("{byte:02x}")).collect();
            assert_eq!(hash, sha256, "{path}");
        }
        assert!(include_str!("page/vendor/LICENSE").starts_with("The MIT License"));
    }

    #[test]
    fn every_file_is_served_and_everything_imported_is_there() {
        let served = |path: &str| ASSETS.iter().any(|asset| asset.path == path);
        let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("src/dashboard/page");
        for entry in std::fs::read_dir(&folder).unwrap() {
            let entry = entry.unwrap();
            let name = entry.file_name().into_string().unwrap();
            let is_page = entry.path().is_dir() || name == "index.html";
            assert!(is_page || served(&format!("/dashboard/{name}")), "{name} is not served");
        }
        for asset in ASSETS.iter().filter(|asset| asset.content_type == SCRIPT && is_ours(asset)) {
            for import in asset.text.split("from \"./").skip(1) {
                let name = import.split('"').next().unwrap();
                assert!(served(&format!("/dashboard/{name}")), "{} imports {name}", asset.path);
            }
            assert!(asset.text.lines().count() <= 300, "{} is too long to be read", asset.path);
        }
        let page = ASSETS[0].text;
        for link in page.split("=\"/dashboard/").skip(1) {
            let name = link.split('"').next().unwrap();
            assert!(served(&format!("/dashboard/{name}")), "the page names {name}");
        }
    }

    #[test]
    fn the_whole_page_is_below_150_kb_as_it_is_sent() {
        use std::io::Write;
        let sent = |asset: &Asset| {
            let mut gzip =
                flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::default());
            gzip.write_all(asset.text.as_bytes()).unwrap();
            gzip.finish().unwrap().len()
        };
        let bytes: usize = ASSETS.iter().map(sent).sum();
        assert!(bytes < 150_000, "{bytes}");
    }
}

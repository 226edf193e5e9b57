//! The dashboard: static files inside the program.
//!
//! The page reads `/api/v1` as any other client does. This module must not know anything of ours.

use axum::Router;
use axum::http::header;
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
        "fleet.js" "machine.js" "signals.js" "spectra.js" "usual.js" "pictures.js" "alarms.js" "acts.js" "captures.js" "demo.js" "maintenance.js" "feedback.js";
];

/// Gives the routes of the page.
pub fn router() -> Router {
    ASSETS.iter().fold(Router::new(), |router, asset| {
        let file = async || ([(header::CONTENT_TYPE, asset.content_type)], asset.text);
        router.route(asset.path, get(file))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use axum::body::{Body, to_bytes};
    use axum::http::{Request, StatusCode};
    use tower::ServiceExt;

    #[tokio::test]
    async fn every_file_is_served_as_what_it_is() {
        for asset in ASSETS {
            let request = Request::get(asset.path).body(Body::empty()).unwrap();
            let response = router().oneshot(request).await.unwrap();
            assert_eq!(response.status(), StatusCode::OK);
            assert_eq!(response.headers()[header::CONTENT_TYPE], asset.content_type);
            let body = to_bytes(response.into_body(), usize::MAX).await.unwrap();
            assert_eq!(body, asset.text);
        }
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

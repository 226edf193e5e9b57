//! The status page: three static files inside the program, served with an ETag.
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

const ASSETS: [Asset; 3] = [
    Asset { path: "/", content_type: "text/html; charset=utf-8", text: include_str!("index.html") },
    Asset {
        path: "/dashboard.js",
        content_type: "text/javascript; charset=utf-8",
        text: include_str!("dashboard.js"),
    },
    Asset {
        path: "/dashboard.css",
        content_type: "text/css; charset=utf-8",
        text: include_str!("dashboard.css"),
    },
];

/// Gives the routes of the page.
pub fn router() -> Router {
    ASSETS.into_iter().fold(Router::new(), |router, asset| {
        router.route(asset.path, get(async move |headers: HeaderMap| serve(asset, &headers)))
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

    #[test]
    fn the_page_loads_nothing_from_elsewhere_and_writes_text_only() {
        for asset in ASSETS {
            for word in
                ["http://", "https://", "@import", "innerHTML", "eval(", "onclick", "style="]
            {
                // The SVG namespace is a name, not an address.
                let text = asset.text.replace("http://www.w3.org/2000/svg", "");
                assert!(!text.contains(word), "{} holds {word}", asset.path);
            }
        }
    }
}

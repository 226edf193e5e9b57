//! Who comes in, what they may do, and what is there for them.

use crate::access::{Counters, Door, Role, Secret, Token, Tokens};
use crate::api::support::{Answer, Service};
use crate::signal::Timestamp;
use axum::body::Body;
use axum::http::{Method, Request, header};
use serde_json::json;
use std::sync::Arc;

const ROLES: [(u8, Role); 4] =
    [(1, Role::Viewer), (2, Role::Operator), (3, Role::Admin), (4, Role::Ingest)];

/// An admin of a machine that is not there.
const ELSEWHERE: u8 = 5;

fn secret(n: u8) -> String {
    Secret::of(&[n; 32]).reveal().to_owned()
}

fn tokens() -> Tokens {
    let mut tokens = Tokens::default();
    let mut add = |n: u8, role: Role, machines: &[String]| {
        let token = Token::new(
            &Secret::of(&[n; 32]),
            (&format!("token {n}"), role),
            machines,
            (None, None),
        );
        tokens.add(token.unwrap()).unwrap();
    };
    for (n, role) in ROLES {
        add(n, role, &[]);
    }
    add(ELSEWHERE, Role::Admin, &["rig-2".to_owned()]);
    tokens
}

fn guarded(service: Service) -> (Service, Arc<Door>) {
    let door = Door::new(Some(tokens()), Counters::default(), Arc::new(|| (Timestamp(0), 0.0)));
    let door = Arc::new(door);
    (service.with_door(Arc::clone(&door)), door)
}

async fn ask(service: &Service, method: &Method, path: &str, token: Option<u8>) -> Answer {
    let mut request = Request::builder().method(method).uri(path);
    if let Some(n) = token {
        request = request.header(header::AUTHORIZATION, format!("Bearer {}", secret(n)));
    }
    let body = if *method == Method::POST {
        request = request.header(header::CONTENT_TYPE, "application/json");
        Body::from("{}")
    } else {
        Body::empty()
    };
    service.send_body(request, body).await
}

/// Every operation of the document, with the role it says, and a path for it.
fn operations() -> Vec<(Method, String, Option<Role>)> {
    let document: serde_json::Value = serde_json::from_str(&crate::api::openapi_text()).unwrap();
    let mut found = Vec::new();
    for (path, item) in document["paths"].as_object().unwrap() {
        for (method, operation) in item.as_object().unwrap() {
            let said =
                operation["description"].as_str().and_then(|text| text.rsplit_once("Role: "));
            let role = said.map(|(_, role)| Role::parse(role.trim_end_matches('.')).unwrap());
            let path = path.replace("alarms/{id}", "alarms/rig-1:1");
            let path = ["id", "bid", "name", "kind", "component", "number", "file"]
                .iter()
                .fold(path, |path, part| path.replace(&format!("{{{part}}}"), "rig-1"));
            assert!(!path.contains('{'), "{path}");
            found.push((method.to_uppercase().parse().unwrap(), path, role));
        }
    }
    found
}

#[tokio::test]
async fn without_a_token_every_path_is_401_and_says_nothing_of_what_there_is() {
    let (service, _) = guarded(Service::new());
    let operations = operations();
    assert!(operations.len() > 30);
    for (method, path, role) in operations {
        let answer = ask(&service, &method, &path, None).await;
        let Some(_) = role else {
            assert_eq!((path.as_str(), answer.status.as_u16()), ("/livez", 200));
            continue;
        };
        let detail = answer.problem(401);
        assert_eq!(detail, "a token is needed; say it as: authorization: Bearer TOKEN", "{path}");
        assert_eq!(answer.header("www-authenticate"), "Bearer realm=\"rotorwatch\"");
    }
    // The same for what is not there, by whatever method.
    for path in ["/nothing", "/api/v1/machines/rig-9", "/api/v1/alarms/rig-9:1/ack", "/panics/x"] {
        for method in [Method::GET, Method::POST, Method::DELETE, Method::PATCH] {
            ask(&service, &method, path, None).await.problem(401);
        }
    }
    assert_eq!(ask(&service, &Method::GET, "/", None).await.status, 200, "the page holds no data");
}

#[tokio::test]
async fn a_token_that_is_not_known_is_401_and_a_url_takes_none() {
    let (service, _) = guarded(Service::new());
    let path = "/api/v1/machines";
    ask(&service, &Method::GET, &format!("{path}?token={}", secret(1)), None).await.problem(401);
    for said in
        ["", "Bearer", "Bearer ", "Basic dTpw", &format!("bearer {}", secret(9)), &secret(1)]
    {
        let request = Request::get(path).header(header::AUTHORIZATION, said);
        let answer = service.send(request).await;
        assert!(!answer.problem(401).contains("rotorwatch_"), "{said}");
        assert!(answer.header("www-authenticate").starts_with("Bearer"));
    }
    let request =
        Request::get(path).header(header::AUTHORIZATION, format!("bearer  {}", secret(1)));
    assert_eq!(service.send(request).await.status, 200, "the scheme has no case");
}

#[tokio::test]
async fn each_role_may_what_the_document_says_and_is_told_why_not() {
    let (service, _) = guarded(Service::new());
    for (method, path, needed) in operations() {
        let Some(needed) = needed else { continue };
        // It does not end.
        if path == "/api/v1/events" {
            continue;
        }
        for (n, role) in ROLES {
            let answer = ask(&service, &method, &path, Some(n)).await;
            if role.may(needed) {
                assert!(!matches!(answer.status.as_u16(), 401 | 403), "{role:?} {method} {path}");
                continue;
            }
            let detail = answer.problem(403);
            let expected = format!("with the role {}, and yours is {}", needed.name(), role.name());
            assert!(detail.contains(&expected), "{path}: {detail}");
            assert!(answer.header("www-authenticate").contains("insufficient_scope"));
            // The same answer for what is not there.
            let other = ask(&service, &method, &path.replace("rig-1", "rig-9"), Some(n)).await;
            assert_eq!(other.problem(403), detail);
        }
    }
}

#[tokio::test]
async fn the_exceptions_are_these() {
    let of = |role: Role| -> Vec<String> {
        let all = operations().into_iter().filter(|(method, _, needed)| {
            let usual = if *method == Method::GET { Role::Viewer } else { Role::Operator };
            *needed == Some(role) && usual != role
        });
        all.map(|(method, path, _)| format!("{method} {path}")).collect()
    };
    assert_eq!(of(Role::Operator), ["GET /api/v1/audit", "GET /api/v1/configurations"]);
    assert_eq!(of(Role::Ingest), ["GET /api/v1/ingest"]);
    assert_eq!(
        of(Role::Admin),
        [
            "GET /api/v1/log",
            "POST /api/v1/machines/rig-1/baselines",
            "DELETE /api/v1/machines/rig-1/baselines/rig-1",
            "POST /api/v1/machines/rig-1/baselines/rig-1/activate",
            "POST /api/v1/simulation/scenario",
        ]
    );
}

#[tokio::test]
async fn a_machine_that_a_token_is_not_of_is_not_there() {
    let (service, _) = guarded(Service::new());
    for path in ["/api/v1/machines", "/api/v1/alarms"] {
        assert_eq!(
            ask(&service, &Method::GET, path, Some(ELSEWHERE)).await.json()["items"],
            json!([])
        );
    }
    let load = ask(&service, &Method::GET, "/api/v1/alarms/load", Some(ELSEWHERE)).await.json();
    assert_eq!((&load["machines"], &load["last_hour"]), (&json!([]), &json!(0)));
    let system = ask(&service, &Method::GET, "/api/v1/system", Some(ELSEWHERE)).await.json();
    assert_eq!(system["streams"], json!([]));
    assert_eq!(system["security"]["you"], "token 5");
    let mut n = 0;
    for (method, path, role) in operations() {
        if role.is_none() || !path.contains("rig-1") || path.contains("captures/rig-1") {
            continue;
        }
        // As it answers for what nobody has.
        let found = ask(&service, &method, &path, Some(ELSEWHERE)).await;
        let nobody = path.replace("rig-1", "rig-9");
        let none = ask(&service, &method, &nobody, Some(ELSEWHERE)).await;
        assert_eq!(found.status, none.status, "{method} {path}");
        let text = |answer: &Answer| String::from_utf8(answer.body.to_vec()).unwrap();
        assert_eq!(text(&found).replace("rig-1", "rig-9"), text(&none), "{method} {path}");
        n += 1;
    }
    assert!(n > 15, "{n}");
    let detail = ask(&service, &Method::GET, "/metrics", Some(ELSEWHERE)).await.problem(403);
    assert!(detail.contains("all machines at once"), "{detail}");
    ask(&service, &Method::GET, "/api/v1/events?machine=rig-1", Some(ELSEWHERE)).await.problem(404);
}

#[tokio::test]
async fn the_author_of_an_act_is_the_label_whatever_is_said() {
    let (service, door) = guarded(Service::new());
    let act = async |body: serde_json::Value| {
        let request = Request::post("/api/v1/alarms/rig-1:1/shelve")
            .header(header::CONTENT_TYPE, "application/json")
            .header(header::AUTHORIZATION, format!("Bearer {}", secret(2)));
        service.send_body(request, Body::from(body.to_string())).await
    };
    for body in [json!({ "for_s": 60, "author": "the director" }), json!({ "for_s": 60 })] {
        let alarm = act(body).await.json();
        assert_eq!(alarm["silenced"]["author"], "token 2", "{alarm}");
    }
    door.set(Tokens::default());
    act(json!({ "for_s": 60 })).await.problem(401);
    // Without tokens a name is needed.
    let open = Service::new();
    let detail = open.post("/api/v1/alarms/rig-1:1/ack", json!({}).to_string()).await.problem(400);
    assert!(detail.contains("author"), "{detail}");
}

#[tokio::test]
async fn pages_of_others_change_nothing_unless_they_are_configured() {
    let service = Service::new();
    let post = |name: &'static str, value: &'static str| {
        let request = Request::post("/api/v1/alarms/rig-1:1/ack")
            .header(header::CONTENT_TYPE, "application/json")
            .header(name, value);
        service.send_body(request, Body::from(json!({ "author": "a" }).to_string()))
    };
    for (name, value) in
        [("origin", "http://evil.example"), ("origin", "null"), ("sec-fetch-site", "cross-site")]
    {
        let answer = post(name, value).await;
        answer.problem(403);
        assert_eq!(answer.json()["type"], "urn:rotorwatch:problem:foreign-origin");
    }
    assert_eq!(post("origin", "http://127.0.0.1:8080").await.status, 200);
    let origin = "https://dash.example.org";
    let configured = Service::with(crate::api::support::Behaviour::Answers, |settings| {
        settings.cors_origins = vec![origin.to_owned()];
    });
    let preflight = Request::options("/api/v1/alarms/rig-1:1/ack")
        .header("origin", origin)
        .header("access-control-request-method", "POST")
        .header("access-control-request-headers", "authorization,content-type");
    let answer = configured.send(preflight).await;
    assert_eq!(answer.header("access-control-allow-origin"), origin);
    assert!(answer.header("access-control-allow-headers").contains("authorization"));
    let other = Request::get("/api/v1/machines").header("origin", "https://evil.example");
    assert_eq!(configured.send(other).await.header("access-control-allow-origin"), "");
    let one = Request::get("/api/v1/machines").header("origin", origin);
    assert_eq!(configured.send(one).await.header("access-control-allow-origin"), origin);
}

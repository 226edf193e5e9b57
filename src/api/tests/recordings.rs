//! Recordings: listed newest first in pages, given as files; nothing else of the store is.

use crate::api::support::Service;
use serde_json::{Value, json};
use std::fs;
use std::path::Path;

/// A recording there is.
pub(in crate::api) const FILE: &str = "rig-1-00000001.h5";

/// The service with a folder of three recordings, and things that are none.
pub(in crate::api) fn kept(service: Service, folder: &Path) -> Service {
    let root = folder.join("recordings");
    fs::create_dir_all(root.join("rig-1")).unwrap();
    for number in 1..4 {
        fs::write(root.join(format!("rig-1/rig-1-{number:08}.h5")), "123456789").unwrap();
    }
    for other in ["rig-1-00000004.h5.damaged", ".rig-1-00000005.h5.1.part", "notes.txt"] {
        fs::write(root.join("rig-1").join(other), "not a recording").unwrap();
    }
    service.with_recordings(root)
}

fn names(page: &Value) -> Vec<&str> {
    page["items"].as_array().unwrap().iter().map(|item| item["file"].as_str().unwrap()).collect()
}

#[tokio::test]
async fn recordings_are_listed_and_given() {
    let folder = tempfile::TempDir::new().unwrap();
    let service = kept(Service::new(), folder.path());
    let path = "/api/v1/machines/rig-1/recordings";
    let page = service.get(&format!("{path}?limit=2")).await.json();
    assert_eq!(names(&page), ["rig-1-00000003.h5", "rig-1-00000002.h5"]);
    assert_eq!(page["items"][0]["bytes"], json!(9));
    assert_eq!(page["items"][0]["state"], json!("finished"));
    let last = service.get(&format!("{path}?after={}", page["next"].as_str().unwrap())).await;
    assert_eq!((names(&last.json()), &last.json()["next"]), (vec![FILE], &Value::Null));
    let given = service.get(&format!("{path}/{FILE}")).await;
    assert_eq!((given.status.as_u16(), &given.body[..]), (200, &b"123456789"[..]));
}

#[tokio::test]
async fn nothing_else_is_given() {
    let folder = tempfile::TempDir::new().unwrap();
    let service = kept(Service::new(), folder.path());
    for (path, words) in [
        ("rig-1/recordings/rig-1-00000009.h5", "no recording"),
        ("rig-1/recordings/rig-1-00000004.h5.damaged", "no recording"),
        ("rig-1/recordings/..%2frig-1%2frig-1-00000001.h5", "no recording"),
        ("other/recordings", "no machine"),
        ("other/recordings/rig-1-00000001.h5", "no machine"),
    ] {
        let answer = service.get(&format!("/api/v1/machines/{path}")).await;
        assert_eq!(answer.status.as_u16(), 404, "{path}: {:?}", answer.body);
        let detail = answer.json()["detail"].as_str().unwrap().to_owned();
        assert!(detail.contains(words), "{path}: {detail}");
    }
    let nothing = Service::new().with_recordings(folder.path().join("elsewhere"));
    let page = nothing.get("/api/v1/machines/rig-1/recordings").await.json();
    assert_eq!(page, json!({ "items": [], "next": null }));
}

//! The scenes that come with the program: the files of `config/scenes/`.

/// Name and text of every scene, by name.
const SCENES: &[(&str, &str)] = &[
    ("demo", include_str!("../../../config/scenes/demo.toml")),
    ("seed-bearing-40hz", include_str!("../../../config/scenes/seed-bearing-40hz-3.toml")),
    ("seed-bearing-40hz-0", include_str!("../../../config/scenes/seed-bearing-40hz-0.toml")),
    ("seed-bearing-40hz-1", include_str!("../../../config/scenes/seed-bearing-40hz-1.toml")),
    ("seed-bearing-40hz-2", include_str!("../../../config/scenes/seed-bearing-40hz-2.toml")),
    ("seed-bearing-40hz-3", include_str!("../../../config/scenes/seed-bearing-40hz-3.toml")),
    ("seed-bow-2hz", include_str!("../../../config/scenes/seed-bow-2hz.toml")),
];

/// The text of a scene; `None` if there is none of this name.
#[must_use]
pub fn text(name: &str) -> Option<&'static str> {
    SCENES.iter().find(|(known, _)| *known == name).map(|(_, text)| *text)
}

/// Names of all scenes.
pub fn names() -> impl Iterator<Item = &'static str> {
    SCENES.iter().map(|(name, _)| *name)
}

//! The scenes that come with the program: the files of `config/scenes/`.

/// Name and text of every scene, by name.
const SCENES: &[(&str, &str)] = &[
    ("BG_BS_BB", include_str!("../../../config/scenes/BG_BS_BB.toml")),
    ("BG_BS_GB", include_str!("../../../config/scenes/BG_BS_GB.toml")),
    ("BG_GS_BB", include_str!("../../../config/scenes/BG_GS_BB.toml")),
    ("BG_GS_GB", include_str!("../../../config/scenes/BG_GS_GB.toml")),
    ("GG_BS_BB", include_str!("../../../config/scenes/GG_BS_BB.toml")),
    ("GG_BS_GB", include_str!("../../../config/scenes/GG_BS_GB.toml")),
    ("GG_GS_BB", include_str!("../../../config/scenes/GG_GS_BB.toml")),
    ("GG_GS_GB", include_str!("../../../config/scenes/GG_GS_GB.toml")),
    ("reducer-10hz", include_str!("../../../config/scenes/reducer-10hz.toml")),
    ("run-up", include_str!("../../../config/scenes/run-up.toml")),
    ("seed-bearing-40hz", include_str!("../../../config/scenes/seed-bearing-40hz-3.toml")),
    ("seed-bearing-40hz-0", include_str!("../../../config/scenes/seed-bearing-40hz-0.toml")),
    ("seed-bearing-40hz-1", include_str!("../../../config/scenes/seed-bearing-40hz-1.toml")),
    ("seed-bearing-40hz-2", include_str!("../../../config/scenes/seed-bearing-40hz-2.toml")),
    ("seed-bearing-40hz-3", include_str!("../../../config/scenes/seed-bearing-40hz-3.toml")),
    ("seed-bow-2hz", include_str!("../../../config/scenes/seed-bow-2hz.toml")),
    ("seed-gear-10hz", include_str!("../../../config/scenes/seed-gear-10hz.toml")),
];

/// Machine files that those scenes name, and their text.
const MACHINES: &[(&str, &str)] = &[
    ("../machines/reducer.toml", include_str!("../../../config/machines/reducer.toml")),
    ("../machines/rig.toml", include_str!("../../../config/machines/rig.toml")),
];

/// The text of a machine file that a built-in scene names; `None` if none does.
#[must_use]
pub fn machine(file: &str) -> Option<&'static str> {
    MACHINES.iter().find(|(known, _)| *known == file).map(|(_, text)| *text)
}

/// The text of a scene; `None` if there is none of this name.
#[must_use]
pub fn text(name: &str) -> Option<&'static str> {
    SCENES.iter().find(|(known, _)| *known == name).map(|(_, text)| *text)
}

/// Names of all scenes.
pub fn names() -> impl Iterator<Item = &'static str> {
    SCENES.iter().map(|(name, _)| *name)
}

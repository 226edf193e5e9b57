//! `[shaft]` or two `[[shaft]]`, and which of them a part is on.

use super::lengths::{Span, length, length_keys, number_or};
use super::parts::{MAX_M, POISSON, YOUNG_GPA};
use super::{SceneBearing, SceneGear, SceneMate, SceneShaft};
use crate::machine::file::general::ID;
use crate::machine::file::range::NumberRange;
use crate::machine::file::reader::{Ids, Need, Section, TextRule};
use crate::simulator::beam;
use crate::simulator::model::MAX_SHAFTS;

/// Steel, unless another is given.
const YOUNG_DEFAULT_GPA: f64 = 206.8;
const POISSON_DEFAULT: f64 = 0.29;
const DENSITY_DEFAULT: f64 = 7833.4;
const DENSITY: NumberRange = NumberRange::positive_up_to(30_000.0);

/// Identifier of a single shaft that has none.
const ID_DEFAULT: &str = "shaft";

/// Rule of identifiers that are looked up by hand.
pub(super) const ANY: TextRule =
    TextRule { keeps: |text| !text.is_empty(), allowed: "the id of a [[shaft]]" };

/// The shafts of a scene as far as they could be read.
pub(super) struct Shafts {
    read: Vec<(String, Option<SceneShaft>)>,
}

/// A shaft that carries a part.
#[derive(Clone, Copy)]
pub(super) struct Carrier {
    /// Its number.
    pub(super) number: usize,
    /// Its length, m. Without a shaft the places on it are still read; none is then outside.
    pub(super) length_m: f64,
    /// Its diameter, m.
    pub(super) diameter_m: Option<f64>,
}

impl Shafts {
    /// Reads the shafts of a document.
    pub(super) fn read(root: &mut Section<'_>) -> Self {
        if !root.is_array("shaft") {
            let mut table = root.table("shaft", Need::Required);
            let id = table.as_mut().and_then(|section| section.text("id", Need::Optional, &ID));
            let id = id.unwrap_or(ID_DEFAULT).to_owned();
            return Self { read: vec![(id.clone(), table.and_then(|section| shaft(section, id)))] };
        }
        let mut sections = root.tables("shaft", Need::Required);
        let ids = Ids::read("shaft", "id", &mut sections, &ID);
        if sections.len() > MAX_SHAFTS {
            root.refuse("shaft", format!("up to {MAX_SHAFTS} tables [[shaft]]"));
        }
        let with_id = |(i, section): (usize, Section<'_>)| {
            let id = ids.get(i).unwrap_or_default().to_owned();
            (id.clone(), shaft(section, id))
        };
        Self { read: sections.into_iter().enumerate().map(with_id).collect() }
    }

    /// A shaft by its number.
    pub(super) fn carrier(&self, number: usize) -> Carrier {
        let shaft = self.read.get(number).and_then(|(_, shaft)| shaft.as_ref());
        Carrier {
            number,
            length_m: shaft.map_or(f64::MAX, |shaft| shaft.length_m),
            diameter_m: shaft.map(|shaft| shaft.section.diameter_m),
        }
    }

    /// Reads the key `shaft` of a part: the first one unless it is named.
    pub(super) fn of(&self, s: &mut Section<'_>) -> Option<Carrier> {
        let id = s.text("shaft", Need::Optional, &ANY);
        if !s.has("shaft") {
            return Some(self.carrier(0));
        }
        let id = id?;
        let number = self.read.iter().position(|(known, _)| known == id);
        if number.is_none() {
            let names: Vec<&str> = self.read.iter().map(|(id, _)| id.as_str()).collect();
            s.refuse("shaft", format!("the id of a shaft: {}", names.join(", ")));
        }
        number.map(|number| self.carrier(number))
    }

    /// The second shaft, if there is one that could be read.
    pub(super) fn second(&self) -> Option<&SceneShaft> {
        self.read.get(1).and_then(|(_, shaft)| shaft.as_ref())
    }

    /// Whether there are two.
    pub(super) fn are_two(&self) -> bool {
        self.read.len() > 1
    }

    /// All shafts, if all could be read.
    pub(super) fn all(self) -> Option<Vec<SceneShaft>> {
        self.read.into_iter().map(|(_, shaft)| shaft).collect()
    }

    /// Each of two shafts must be held, and a gear must join them.
    pub(super) fn check(
        &self,
        root: &Section<'_>,
        bearings: &[Option<SceneBearing>],
        gears: &[Option<SceneGear>],
    ) {
        let all_read = bearings.iter().all(Option::is_some) && gears.iter().all(Option::is_some);
        if !self.are_two() || !all_read {
            return;
        }
        for (number, (id, _)) in self.read.iter().enumerate() {
            let on_it = bearings.iter().flatten().filter(|b| b.place.shaft == number).count();
            if on_it < 2 {
                let found = format!("{on_it} on shaft {id}");
                let allowed = "at least 2 tables [[bearing]] on every shaft (their key shaft)";
                root.log().report(root.at("bearing"), "bearing".to_owned(), found, allowed);
            }
        }
        if !gears.iter().flatten().any(|gear| matches!(gear.mate, SceneMate::Shaft(_))) {
            let found = "two shafts that no gear joins";
            let allowed = "a [[gear]] with drive = \"shaft\": it sits on the first shaft, its mate on the second";
            root.log().report(root.at("shaft"), "shaft".to_owned(), found, allowed);
        }
    }
}

/// Reads a shaft: its section, and its length.
fn shaft(mut section: Section<'_>, id: String) -> Option<SceneShaft> {
    let s = &mut section;
    let length_m = length(s, length_keys!("length"), Need::Required, Span::Positive(MAX_M));
    let diameter_m = length(s, length_keys!("diameter"), Need::Required, Span::Positive(MAX_M));
    let young_gpa = number_or(s, "young_gpa", YOUNG_GPA, YOUNG_DEFAULT_GPA);
    let poisson = number_or(s, "poisson", POISSON, POISSON_DEFAULT);
    let density = number_or(s, "density_kg_per_m3", DENSITY, DENSITY_DEFAULT);
    section.finish();
    let beam = beam::Section {
        diameter_m: diameter_m?,
        young_pa: young_gpa? * 1e9,
        poisson: poisson?,
        density_kg_per_m3: density?,
    };
    Some(SceneShaft { id, section: beam, length_m: length_m? })
}

//! "Did you mean": the allowed name nearest to a misspelt one.

/// Longer names are not compared: no key or kind is that long.
const MAX_CHARS: usize = 64;

/// Gives the name nearest to `written`, if it is near enough to be meant.
///
/// Near enough: at most a third of the longer name's characters changed, inserted, left out or
/// swapped with their neighbour; case does not count.
pub(crate) fn nearest<'n>(
    written: &str,
    names: impl IntoIterator<Item = &'n str>,
) -> Option<&'n str> {
    let written: Vec<char> = written.to_lowercase().chars().take(MAX_CHARS + 1).collect();
    if written.is_empty() || written.len() > MAX_CHARS {
        return None;
    }
    names
        .into_iter()
        .filter_map(|name| {
            let lower: Vec<char> = name.to_lowercase().chars().take(MAX_CHARS).collect();
            let distance = edit_distance(&written, &lower);
            (3 * distance <= written.len().max(lower.len())).then_some((distance, name))
        })
        .min()
        .map(|(_, name)| name)
}

/// Words the suggestion, or nothing.
pub(crate) fn suggestion<'n>(written: &str, names: impl IntoIterator<Item = &'n str>) -> String {
    nearest(written, names).map_or_else(String::new, |name| format!(" (did you mean `{name}`?)"))
}

/// Edits that turn `a` into `b`: change, insert, leave out, swap neighbours (each letter once).
pub(super) fn edit_distance(a: &[char], b: &[char]) -> usize {
    let width = b.len() + 1;
    let mut cost = vec![0; (a.len() + 1) * width];
    for i in 0..=a.len() {
        for j in 0..=b.len() {
            let at = |i: usize, j: usize| i * width + j;
            cost[at(i, j)] = if i == 0 || j == 0 {
                i + j
            } else {
                let change = cost[at(i - 1, j - 1)] + usize::from(a[i - 1] != b[j - 1]);
                let insert_or_leave_out = cost[at(i - 1, j)].min(cost[at(i, j - 1)]) + 1;
                let swapped = i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1];
                let swap = if swapped { cost[at(i - 2, j - 2)] + 1 } else { usize::MAX };
                change.min(insert_or_leave_out).min(swap)
            };
        }
    }
    cost[a.len() * width + b.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slips_of_the_finger_are_recognised() {
        let keys = ["elements", "element_diameter_mm", "pitch_diameter_mm", "id", "shaft"];
        assert_eq!(nearest("elemnets", keys), Some("elements"));
        assert_eq!(nearest("Pitch_diameter", keys), Some("pitch_diameter_mm"));
        assert_eq!(nearest("shafts", keys), Some("shaft"));
        assert_eq!(nearest("colour", keys), None);
        assert_eq!(nearest("", keys), None);
        assert_eq!(nearest(&"x".repeat(1_000_000), keys), None);
    }
}

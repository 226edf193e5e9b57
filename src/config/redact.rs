//! A configuration as it may be shown: without what is, or may be, a secret. Comments are not shown either.

use super::keys;
use toml::Table;
use toml::Value;

/// What stands in the place of a value.
const HIDDEN: &str = "(not shown)";

/// The text of a configuration with the values of known keys that are no secrets; whatever else it says is not shown.
#[must_use]
pub fn redacted(text: &str) -> String {
    let shown = text.parse::<Table>().ok().and_then(|mut all| {
        table(&mut all, "");
        toml::to_string(&all).ok()
    });
    shown.unwrap_or_else(|| "# It cannot be read as TOML, and is not shown.\n".to_owned())
}

fn table(all: &mut Table, section: &str) {
    for (name, value) in all.iter_mut() {
        let path = if section.is_empty() { name.clone() } else { format!("{section}.{name}") };
        let is_above = |known: &&str| **known == path || known.starts_with(&format!("{path}."));
        let is_section = keys::SECTIONS.iter().chain(keys::LISTS).any(is_above);
        let is_shown = keys::find(section, name).is_some_and(|key| !key.is_secret());
        if let Some(inner) = value.as_table_mut().filter(|_| is_section) {
            table(inner, &path);
        } else if let Some(items) =
            value.as_array_mut().filter(|items| is_section && items.iter().all(Value::is_table))
        {
            items.iter_mut().filter_map(Value::as_table_mut).for_each(|inner| table(inner, &path));
        } else if !is_shown {
            *value = Value::String(HIDDEN.to_owned());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_no_known_key_or_a_secret_is_not_shown() {
        let text = r#"
            # the old one was hunter2
            [server]
            bind = "127.0.0.1:8080"
            password = "hunter2"
            [server.tls]
            key_file = "key.pem"
            [[notify.webhook]]
            name = "room"
            url = "https://example.org/hunter2"
            secret = "hunter2"
            headers = ["authorization: hunter2"]
            [unknown]
            bind = "hunter2"
            [pipeline.hunter]
            workers = "hunter2"
        "#;
        let shown = redacted(text);
        assert!(!shown.contains("hunter2"), "{shown}");
        for kept in ["127.0.0.1:8080", "key.pem", "name = \"room\"", HIDDEN] {
            assert!(shown.contains(kept), "{kept}: {shown}");
        }
        assert!(!redacted("password = hunter2").contains("hunter2"), "no TOML");
    }

    #[test]
    fn the_reference_is_shown_whole() {
        let all: Table = super::super::REFERENCE.parse().unwrap();
        assert_eq!(redacted(super::super::REFERENCE).parse::<Table>().unwrap(), all);
    }
}

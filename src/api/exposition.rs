//! Metrics in the older text format of Prometheus, for tools that do not read OpenMetrics.

use std::collections::BTreeMap;

/// Content type of the older format.
pub(super) const CONTENT_TYPE: &str = "text/plain; version=0.0.4; charset=utf-8";

/// OpenMetrics as the older format: counters and infos are named as their samples are, and there are no units and no end.
pub(super) fn classic(open_metrics: &str) -> String {
    let about = |line: &str, word: &str| {
        let (name, rest) = line.strip_prefix(word)?.split_once(' ')?;
        Some((name.to_owned(), rest.to_owned()))
    };
    let kinds: BTreeMap<String, String> =
        open_metrics.lines().filter_map(|line| about(line, "# TYPE ")).collect();
    let named = |name: &str| match kinds.get(name).map(String::as_str) {
        Some("counter") => format!("{name}_total"),
        Some("info") => format!("{name}_info"),
        _ => name.to_owned(),
    };
    let mut text = String::with_capacity(open_metrics.len());
    for line in open_metrics.lines() {
        if let Some((name, help)) = about(line, "# HELP ") {
            text.push_str(&format!("# HELP {} {help}\n", named(&name)));
        } else if let Some((name, kind)) = about(line, "# TYPE ") {
            let kind = match kind.as_str() {
                "info" => "gauge",
                "unknown" => "untyped",
                kind => kind,
            };
            text.push_str(&format!("# TYPE {} {kind}\n", named(&name)));
        } else if !line.starts_with('#') {
            text.push_str(line);
            text.push('\n');
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counters_and_infos_are_named_as_their_samples() {
        let open = "# HELP a_build The program.\n# TYPE a_build info\na_build_info{version=\"1\"} 1\n\
                    # HELP a_n Things.\n# TYPE a_n counter\na_n_total 3\n\
                    # HELP a_s Time.\n# TYPE a_s histogram\n# UNIT a_s seconds\na_s_bucket{le=\"+Inf\"} 1\n# EOF\n";
        assert_eq!(
            classic(open),
            "# HELP a_build_info The program.\n# TYPE a_build_info gauge\na_build_info{version=\"1\"} 1\n\
             # HELP a_n_total Things.\n# TYPE a_n_total counter\na_n_total 3\n\
             # HELP a_s Time.\n# TYPE a_s histogram\na_s_bucket{le=\"+Inf\"} 1\n"
        );
    }
}

//! What people found of verdicts, an entry a line.

use super::Arguments;
use super::ExportError;
use super::PAGE;
use super::field;
use crate::api::wire::rfc3339;
use crate::cli::output::Output;
use crate::cli::output::Spared;
use crate::config::Config;
use crate::diagnosis::fault::FaultMode;
use crate::signal::Timestamp;
use crate::store::feedback::Feedback;
use crate::store::feedback::FeedbackQuery;
use crate::store::feedback::FeedbackStore;
use crate::store::feedback::SqliteFeedback;

/// The columns.
const COLUMNS: &str = "time,machine,number,author,outcome,kind,component,found,note,verdict_time,verdict_state,\
                       verdict_fault,verdict_severity,verdict_confidence,verdict_why,judged_by\n";

/// Writes what was said of the verdicts on these machines, oldest first.
pub(super) fn write(
    arguments: &Arguments,
    config: &Config,
    machines: &[String],
) -> Result<(), ExportError> {
    let mut output = Output::open(arguments.out.as_deref(), &Spared::of(config))?;
    output.write(COLUMNS)?;
    let Some(store) = SqliteFeedback::read_only(&config.store.directory)? else {
        return Ok(output.finish()?);
    };
    for machine in machines {
        let mut before = u64::MAX;
        let mut lines = Vec::new();
        loop {
            let query = FeedbackQuery { machine: machine.clone(), before, limit: PAGE };
            let page = store.list(&query)?;
            let Some((last, _)) = page.last() else { break };
            before = *last;
            let is_wanted = |(_, one): &&(u64, Feedback)| {
                arguments.from.is_none_or(|from| one.at >= from)
                    && arguments.to.is_none_or(|to| one.at < to)
            };
            lines.extend(page.iter().filter(is_wanted).map(|(number, one)| line(*number, one)));
        }
        lines.iter().rev().try_for_each(|line| output.write(line))?;
    }
    Ok(output.finish()?)
}

fn line(number: u64, one: &Feedback) -> String {
    let optional = |value: Option<f64>| value.map_or(String::new(), |value| value.to_string());
    let fault = |fault: Option<FaultMode>| fault.map_or(String::new(), |one| one.name().to_owned());
    let time = |at: Timestamp| rfc3339(Some(at), 0.0);
    let then = &one.judgement;
    let fields = [
        time(one.at),
        field(&one.machine),
        number.to_string(),
        field(&one.author),
        one.finding.name().to_owned(),
        one.component.0.name().to_owned(),
        field(&one.component.1),
        fault(one.found),
        field(&one.note),
        then.at.map_or(String::new(), time),
        then.state.name().to_owned(),
        fault(then.fault),
        optional(then.severity),
        optional(then.confidence),
        field(&then.why),
        field(&then.judged_by),
    ];
    fields.join(",") + "\n"
}

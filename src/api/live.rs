//! Live features of a machine for the stream of events: the newest window's, whenever another one was judged.
//!
//! Nothing waits for a reader: one that is slow, or was away, gets the newest window, and finds the others in the trend.

use super::error::ApiError;
use super::state::ApiState;
use super::view::MachineView;
use super::wire::events::{ChannelFeaturesWire, WindowFeaturesWire};
use super::wire::{finite, rfc3339};
use std::collections::BTreeSet;
use std::sync::Arc;
use tokio::sync::watch;

/// Most names that may be asked for.
const MAX_NAMES: usize = 100;

/// What of which machine is told.
pub(super) struct Live {
    machine: String,
    /// `None`: all features.
    names: Option<Vec<String>>,
    view: watch::Receiver<Arc<MachineView>>,
    /// End of the window that was told last, s.
    told: Option<f64>,
}

impl Live {
    /// The features asked for, from the newest window on; `None`: none are. A reader that comes again may name what is
    /// not measured for the time being.
    ///
    /// # Errors
    /// When the machine is not named, or is not there, no names or too many are given, or one of nothing that is measured.
    pub(super) fn of(
        state: &ApiState,
        (machine, features): (Option<&str>, Option<&str>),
        comes_again: bool,
    ) -> Result<Option<Self>, ApiError> {
        let Some(features) = features else { return Ok(None) };
        let Some(machine) = machine else {
            return Err(ApiError::Invalid("features are those of one machine: name it".to_owned()));
        };
        let names: Vec<String> = features.split(',').map(|name| name.trim().to_owned()).collect();
        if names.len() > MAX_NAMES || names.iter().any(String::is_empty) {
            return Err(ApiError::Invalid(format!(
                "features is {:?}, allowed is `all`, or 1 to {MAX_NAMES} names with commas between",
                features.chars().take(100).collect::<String>()
            )));
        }
        let names = (names != ["all"]).then_some(names);
        let view = state.machine(machine)?.view.clone();
        if !comes_again {
            check_measured(&view.borrow(), names.as_deref().unwrap_or_default())?;
        }
        Ok(Some(Self { machine: machine.to_owned(), names, view, told: None }))
    }

    /// The features of the next window that was not told; `None`: there will be no more.
    pub(super) async fn next(&mut self) -> Option<WindowFeaturesWire> {
        loop {
            let view = Arc::clone(&self.view.borrow_and_update());
            if let Some(end_s) = view.window_end_s.filter(|end_s| self.told != Some(*end_s)) {
                self.told = Some(end_s);
                return Some(self.window(&view, end_s));
            }
            self.view.changed().await.ok()?;
        }
    }

    fn window(&self, view: &MachineView, end_s: f64) -> WindowFeaturesWire {
        let is_wanted = |name: &str| match &self.names {
            Some(names) => names.iter().any(|one| one == name),
            None => true,
        };
        let channels = view.features.iter().filter_map(|of| {
            let info = view.channels.get(of.channel.0)?;
            let wanted: Vec<_> = of.values.iter().filter(|one| is_wanted(&one.name)).collect();
            (!wanted.is_empty()).then(|| ChannelFeaturesWire {
                channel: info.name.clone(),
                start_sample: of.sample_range.0,
                n_samples: of.sample_range.1.saturating_sub(of.sample_range.0),
                name: wanted.iter().map(|one| one.name.to_string()).collect(),
                unit: wanted.iter().map(|one| one.unit.symbol().to_owned()).collect(),
                value: wanted.iter().map(|one| finite(one.value)).collect(),
            })
        });
        WindowFeaturesWire {
            machine: self.machine.clone(),
            time: rfc3339(view.start_time, end_s),
            time_s: finite(end_s),
            time_unknown: view.start_time.is_none(),
            channels: channels.collect(),
        }
    }
}

/// Refuses a name of nothing that the newest window has, if there is one.
fn check_measured(view: &MachineView, names: &[String]) -> Result<(), ApiError> {
    let measured = view.features.iter().flat_map(|of| &of.values);
    let known: BTreeSet<&str> = measured.map(|one| &*one.name).collect();
    match names.iter().find(|name| !known.contains(name.as_str())) {
        Some(unknown) if !known.is_empty() => {
            let (unknown, known): (String, Vec<_>) =
                (unknown.chars().take(100).collect(), known.into_iter().collect());
            Err(ApiError::Invalid(format!(
                "no feature {unknown:?} is measured in the newest window, allowed are `all` and {}",
                known.join(", ")
            )))
        }
        Some(_) | None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::api::support::Service;

    fn live(service: &Service, features: &str) -> Live {
        Live::of(&service.state, (Some("rig-1"), Some(features)), true).unwrap().unwrap()
    }

    #[tokio::test]
    async fn each_window_is_told_once_and_a_slow_reader_gets_the_newest() {
        let service = Service::new();
        let mut live = live(&service, "rms, crest");
        let first = live.next().await.unwrap();
        assert_eq!((first.time.as_str(), first.time_s), ("2023-11-14T22:13:30Z", Some(10.0)));
        let [channel] = &first.channels[..] else { panic!("{first:?}") };
        assert_eq!((channel.start_sample, channel.n_samples), (0, 40_960));
        assert_eq!(
            (&channel.name[..], &channel.unit[..]),
            (&["rms".into()][..], &["m/s^2".into()][..])
        );
        assert_eq!(channel.value, [Some(1.414)]);
        let publish = |end_s: f64| {
            service.view.send_modify(|view| {
                *view = Arc::new(MachineView { window_end_s: Some(end_s), ..(**view).clone() });
            });
        };
        // Blocks are received, and no window is judged: there is nothing to tell.
        for end_s in [10.0, 10.0, 15.0, 20.0] {
            publish(end_s);
        }
        assert_eq!(live.next().await.unwrap().time_s, Some(20.0));
        drop(service);
        assert_eq!(live.next().await, None);
    }

    #[tokio::test]
    async fn all_is_everything_and_what_is_not_measured_is_not_there() {
        let service = Service::new();
        let all = live(&service, "all").next().await.unwrap();
        assert_eq!(all.channels[0].name, ["rms", "cwt_ratio_1x_main"]);
        assert_eq!(live(&service, "nothing").next().await.unwrap().channels, []);
    }

    #[tokio::test]
    async fn features_are_of_one_machine_that_is_there_and_have_names() {
        let service = Service::new();
        let of = |machine: Option<&str>, features: &str| {
            Live::of(&service.state, (machine, Some(features)), false).err()
        };
        let told = |error: Option<ApiError>| error.unwrap().to_string();
        assert!(told(of(None, "rms")).contains("name it"));
        assert!(told(of(Some("rig-9"), "rms")).contains("no machine"));
        for wrong in ["", ",", "rms,", &"a,".repeat(200)] {
            assert!(told(of(Some("rig-1"), wrong)).contains("allowed is `all`"), "{wrong}");
        }
        let nope = told(of(Some("rig-1"), "rms,nope"));
        assert!(nope.contains("\"nope\"") && nope.contains("rms"), "{nope}");
        assert!(of(Some("rig-1"), "rms,cwt_ratio_1x_main").is_none());
        assert!(Live::of(&service.state, (None, None), false).unwrap().is_none());
        let early = |view: &mut Arc<MachineView>| {
            *view = Arc::new(MachineView { features: Arc::default(), ..(**view).clone() });
        };
        service.view.send_modify(early);
        assert!(of(Some("rig-1"), "nope").is_none(), "no window says what there is");
    }
}

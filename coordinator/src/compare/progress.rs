//! How far a comparison is: a live line on a terminal, a line for each tenth elsewhere, always on standard error.

use std::sync::{Mutex, MutexGuard};
use std::time::Duration;

use cluster::Cluster;
use cluster::events::EventCursor;
use indicatif::{ProgressBar, ProgressStyle};

use crate::console::{Console, has_viewer};
use crate::lock::lock;

/// Clouds that are done under each descriptor.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Stage {
    /// What is done with them, as in "described".
    done_as: &'static str,
    /// Of each descriptor its name, and how many of its clouds are done.
    descriptors: Vec<(String, u32)>,
    /// Clouds of each descriptor.
    clouds: u32,
    /// Tenths of all that were told.
    told: u32,
}

impl Stage {
    fn new(done_as: &'static str, descriptors: impl Iterator<Item = String>, clouds: u32) -> Self {
        Self { done_as, descriptors: descriptors.map(|name| (name, 0)).collect(), clouds, told: 0 }
    }

    fn total(&self) -> u64 {
        self.descriptors.len() as u64 * u64::from(self.clouds)
    }

    fn done(&self) -> u64 {
        self.descriptors.iter().map(|(_, done)| u64::from(*done)).sum()
    }

    /// Adds clouds of a descriptor; whether with them another tenth of all is done.
    fn add(&mut self, descriptor: usize, clouds: u32) -> bool {
        let most = self.clouds;
        if let Some((_, done)) = self.descriptors.get_mut(descriptor) {
            *done = done.saturating_add(clouds).min(most);
        }
        let tenths = (10 * self.done()).checked_div(self.total()).unwrap_or(0) as u32;
        let more = tenths > self.told;
        self.told = self.told.max(tenths);
        more
    }

    /// The first descriptor of which not all clouds are done, or the last, and how far it is.
    fn line(&self) -> String {
        let under_way = self.descriptors.iter().position(|(_, done)| *done < self.clouds);
        let Some(index) = under_way.or(self.descriptors.len().checked_sub(1)) else { return String::new() };
        let ((name, done), of) = (&self.descriptors[index], self.descriptors.len());
        let place = if of == 1 { String::new() } else { format!(", descriptor {} of {of}", index + 1) };
        format!("{} {done} of {} clouds under {name}{place}", self.done_as, self.clouds)
    }
}

/// The display of one comparison.
pub struct Display {
    console: Console,
    events: Option<Mutex<EventCursor>>,
    stage: Mutex<Stage>,
}

impl Display {
    /// A display that shows nothing yet.
    pub fn new() -> Self {
        let console = if has_viewer() {
            let bar = ProgressBar::new(0);
            let style = ProgressStyle::with_template("{spinner} {bar:10} {wide_msg}");
            bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
            bar.set_message("reading the clouds");
            bar.enable_steady_tick(Duration::from_millis(200));
            Console::with(bar)
        } else {
            Console::default()
        };
        Self { console, events: None, stage: Mutex::new(Stage::new("", std::iter::empty(), 0)) }
    }

    /// Prints what happens in a cluster from now on, whenever there is news.
    pub fn follow(&mut self, cluster: &Cluster) {
        self.events = Some(Mutex::new(cluster.events()));
    }

    /// Where lines go.
    pub fn console(&self) -> &Console {
        &self.console
    }

    /// A line that stays.
    pub fn say(&self, line: &str) {
        self.console.say(line);
    }

    /// Workers came or went, or something unusual happened.
    pub fn news(&self) {
        let Some(events) = &self.events else { return };
        let events = lock(events).read_to_end();
        for event in events.iter().filter(|event| event.kind.is_news()) {
            self.say(&event.kind.to_string());
        }
    }

    /// A stage begins, with so many clouds under each descriptor.
    pub fn begin(&self, done_as: &'static str, descriptors: impl Iterator<Item = String>, clouds: u32) {
        let stage = Stage::new(done_as, descriptors, clouds);
        if let Some(bar) = self.console.bar() {
            bar.set_length(stage.total());
            bar.set_position(0);
            bar.set_message(stage.line());
        }
        *self.stage() = stage;
    }

    /// Clouds are done that were done before this start: no line is written of them.
    pub fn found(&self, descriptor: usize, clouds: u32) {
        self.stage().add(descriptor, clouds);
        self.redraw();
    }

    /// Clouds are done.
    pub fn add(&self, descriptor: usize, clouds: u32) {
        let another_tenth = self.stage().add(descriptor, clouds);
        if self.console.bar().is_some() {
            self.redraw();
        } else if another_tenth {
            self.say(&self.stage().line());
        }
    }

    fn redraw(&self) {
        if let Some(bar) = self.console.bar() {
            let stage = self.stage();
            bar.set_position(stage.done());
            bar.set_message(stage.line());
        }
    }

    fn stage(&self) -> MutexGuard<'_, Stage> {
        // Counts for people: no state of them is wrong.
        lock(&self.stage)
    }
}

impl Drop for Display {
    fn drop(&mut self) {
        if let Some(bar) = self.console.bar() {
            bar.finish_and_clear();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_says_under_which_descriptor_and_is_due_at_each_tenth_of_all() {
        let names = ["evolved", "pfhrgb"].map(str::to_owned);
        let mut stage = Stage::new("described", names.into_iter(), 50);
        assert_eq!(stage.line(), "described 0 of 50 clouds under evolved, descriptor 1 of 2");
        assert!(!stage.add(0, 9));
        assert!(stage.add(0, 1));
        assert!(!stage.add(1, 0));
        // Out of order, as answers come.
        assert!(stage.add(1, 30));
        assert_eq!(stage.line(), "described 10 of 50 clouds under evolved, descriptor 1 of 2");
        assert!(stage.add(0, 40));
        assert_eq!(stage.line(), "described 30 of 50 clouds under pfhrgb, descriptor 2 of 2");
        assert!(stage.add(1, 20));
        assert_eq!((stage.done(), stage.total()), (100, 100));
        assert_eq!(stage.line(), "described 50 of 50 clouds under pfhrgb, descriptor 2 of 2");
        assert!(!stage.add(1, 20), "no more than all");

        let mut lines = 0;
        let mut alone = Stage::new("measured", std::iter::once("paper".to_owned()), 7);
        for _ in 0..7 {
            lines += u32::from(alone.add(0, 1));
        }
        assert_eq!((lines, alone.line().as_str()), (7, "measured 7 of 7 clouds under paper"));
        let mut nothing = Stage::new("measured", std::iter::empty(), 7);
        assert!(!nothing.add(0, 1));
        assert_eq!(nothing.line(), "");
    }
}

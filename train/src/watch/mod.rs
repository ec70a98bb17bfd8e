//! Watching a run: terminal, `log.jsonl`, TensorBoard events, `index.html`. All four show the same records.

mod log;
mod page;
mod record;
mod tensorboard;
mod terminal;

pub use log::Log;
pub use page::render;
pub(crate) use record::null_as_nan;
pub use record::{EpisodesRecord, EpochRecord, Record, StepRecord};
pub use tensorboard::EventWriter;
pub use terminal::Terminal;

use crate::TrainError;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Time between two refreshes of the page and two flushes of the files.
const REFRESH: Duration = Duration::from_secs(10);

/// Everything that shows a run.
#[derive(Debug)]
pub struct Watch {
    terminal: Terminal,
    log: Log,
    events: EventWriter,
    records: Vec<Record>,
    dir: PathBuf,
    total_steps: u64,
    refreshed: Instant,
}

impl Watch {
    /// Watches a run in `dir` that has done `step` of `total_steps` and is in epoch `epoch` (from 0) of `epochs`.
    pub fn open(
        dir: &Path,
        (step, epoch): (u64, u32),
        total_steps: u64,
        epochs: u32,
        quiet: bool,
    ) -> Result<Watch, TrainError> {
        let (log, records) = Log::open(&dir.join("log.jsonl"), step, epoch)?;
        let events = EventWriter::create(&dir.join("tensorboard"))?;
        let terminal = Terminal::new(total_steps, step, epochs, quiet);
        let watch =
            Watch { terminal, log, events, records, dir: dir.to_path_buf(), total_steps, refreshed: Instant::now() };
        watch.write_page(false)?;
        Ok(watch)
    }

    /// Takes a record.
    pub fn record(&mut self, record: Record) -> Result<(), TrainError> {
        self.terminal.show(&record);
        self.log.write(&record)?;
        self.write_events(&record)?;
        let epoch = matches!(record, Record::Epoch(_) | Record::Episodes(_));
        self.records.push(record);
        if epoch || self.refreshed.elapsed() > REFRESH {
            self.flush(false)?;
        }
        Ok(())
    }

    /// A sentence for people.
    pub fn message(&mut self, step: u64, text: impl Into<String>) -> Result<(), TrainError> {
        self.record(Record::Message { step, text: text.into() })
    }

    /// The records so far, those of a resumed run included.
    pub fn records(&self) -> &[Record] {
        &self.records
    }

    /// Hands the records to the operating system: before a checkpoint that holds their steps, since a log that is cut back to
    /// it lacks nothing only then.
    pub fn flush_records(&mut self) -> Result<(), TrainError> {
        self.log.flush()?;
        self.events.flush()
    }

    /// Writes everything out; `done` marks the page as final.
    pub fn flush(&mut self, done: bool) -> Result<(), TrainError> {
        self.flush_records()?;
        self.write_page(done)?;
        if done {
            self.terminal.finish();
        }
        self.refreshed = Instant::now();
        Ok(())
    }

    fn write_page(&self, done: bool) -> Result<(), TrainError> {
        let name = self.dir.file_name().map_or_else(|| "training".into(), |n| n.to_string_lossy().into_owned());
        let page = render(&format!("Training {name}"), &self.records, (!done).then_some(self.total_steps));
        Ok(formats::run::atomic_write(&self.dir.join("index.html"), page.as_bytes())?)
    }

    fn write_events(&mut self, record: &Record) -> Result<(), TrainError> {
        let scalars: Vec<(&str, f64)> = match record {
            Record::Step(s) => vec![
                ("loss/step", s.loss),
                ("learning_rate", s.learning_rate),
                ("gradient_norm", s.gradient_norm),
                ("samples_per_second", s.samples as f64 / s.seconds.max(1e-9)),
            ],
            Record::Epoch(e) => vec![
                ("loss/train", e.train_loss),
                ("loss/validation", e.valid_loss),
                ("validation/regret", e.valid.regret),
                ("validation/relative_regret", e.valid.relative_regret()),
                ("validation/rank_correlation", e.valid.rank_correlation),
                ("validation/hit_rate", e.valid.hit_rate),
            ],
            Record::Episodes(e) => vec![("episodes/coverage", e.coverage), ("episodes/views_to_90", e.views_to_90)],
            Record::Message { .. } => return Ok(()),
        };
        self.events.scalars(record.step(), &scalars)
    }
}

//! `log.jsonl`: every record, one JSON object a line, for programs.

use super::record::Record;
use crate::TrainError;
use std::fs::{File, OpenOptions};
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

/// Appends records to a file.
#[derive(Debug)]
pub struct Log {
    file: BufWriter<File>,
    path: PathBuf,
}

impl Log {
    /// Opens `path` for appending after `step` steps, in epoch `epoch` (from 0): records of later steps and of the ends of this
    /// epoch and later ones, left by a run that went on after its last checkpoint, and a last line cut short by a crash are
    /// dropped; every other line stays as it is. Returns the records kept.
    pub fn open(path: &Path, step: u64, epoch: u32) -> Result<(Log, Vec<Record>), TrainError> {
        let text = match std::fs::read_to_string(path) {
            Ok(text) => text,
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => String::new(),
            Err(e) => return Err(TrainError::io("read", path, e)),
        };
        let done = |r: &Record| r.step() <= step && r.ended_epoch().is_none_or(|ended| ended < epoch);
        let (mut kept, mut whole) = (Vec::new(), String::new());
        for line in text.split_inclusive('\n').filter(|_| step > 0) {
            match serde_json::from_str::<Record>(line) {
                Ok(record) if done(&record) => kept.push(record),
                // What another version of the program wrote stays for its readers; only a last line can be cut short.
                Err(_) if line.ends_with('\n') => {}
                Ok(_) | Err(_) => continue,
            }
            whole.push_str(line.trim_end_matches('\n'));
            whole.push('\n');
        }
        formats::run::atomic_write(path, whole.as_bytes())?;
        let file = OpenOptions::new().append(true).open(path).map_err(|e| TrainError::io("open", path, e))?;
        Ok((Log { file: BufWriter::new(file), path: path.to_path_buf() }, kept))
    }

    /// Appends a record. Numbers that JSON cannot hold (NaN) become null, which is read as NaN.
    pub fn write(&mut self, record: &Record) -> Result<(), TrainError> {
        let mut line = serde_json::to_vec(record).map_err(|e| TrainError::io("write", &self.path, e.into()))?;
        line.push(b'\n');
        self.file.write_all(&line).map_err(|e| TrainError::io("write", &self.path, e))
    }

    /// Hands everything to the operating system.
    pub fn flush(&mut self) -> Result<(), TrainError> {
        self.file.flush().map_err(|e| TrainError::io("write", &self.path, e))
    }
}

#[cfg(test)]
mod tests {
    use super::super::record::{EpisodesRecord, EpochRecord, StepRecord};
    use super::*;
    use crate::metrics::RankingMetrics;

    fn step(step: u64) -> Record {
        Record::Step(StepRecord {
            step,
            epoch: 0,
            loss: 0.5,
            learning_rate: 1e-3,
            gradient_norm: 1.0,
            samples: 4,
            seconds: 0.1,
            wait_seconds: 0.0,
        })
    }

    fn episodes(step: u64, epoch: u32) -> Record {
        Record::Episodes(EpisodesRecord { step, epoch, episodes: 8, coverage: 0.9, views_to_90: 4.0, seconds: 1.0 })
    }

    #[test]
    fn losses_without_a_number_and_lines_of_others_stay() {
        let dir = tempfile::tempdir().expect("temp dir");
        let path = dir.path().join("log.jsonl");
        let (mut log, _) = Log::open(&path, 0, 0).expect("open");
        let Record::Step(one) = step(1) else { panic!("a step") };
        log.write(&Record::Step(StepRecord { loss: f64::NAN, ..one })).expect("write");
        let epoch = EpochRecord {
            step: 1,
            epoch: 0,
            train_loss: 0.5,
            valid_loss: f64::INFINITY,
            valid: RankingMetrics { regret: f64::NAN, ..RankingMetrics::default() },
            best: false,
            learning_rate: 1e-3,
            seconds: 1.0,
            samples_per_second: 4.0,
        };
        log.write(&Record::Epoch(epoch)).expect("write");
        log.flush().expect("flush");
        drop(log);
        let mut whole = std::fs::read_to_string(&path).expect("read");
        assert!(whole.contains("\"loss\":null") && whole.contains("\"regret\":null"), "{whole}");
        whole.push_str("{\"kind\":\"of another version\"}\n");
        std::fs::write(&path, whole.clone() + "{\"kind\":\"step\",\"st").expect("write");
        let (_, kept) = Log::open(&path, 1, 1).expect("open again");
        assert_eq!(std::fs::read_to_string(&path).expect("read"), whole);
        let [Record::Step(one), Record::Epoch(epoch)] = &kept[..] else { panic!("{kept:?}") };
        assert!(one.loss.is_nan() && epoch.valid_loss.is_nan() && epoch.valid.regret.is_nan(), "{kept:?}");
    }

    #[test]
    fn a_log_is_cut_back_to_the_checkpoint_it_resumes_from() {
        let dir = tempfile::tempdir().expect("temp dir");
        let path = dir.path().join("log.jsonl");
        let (mut log, kept) = Log::open(&path, 0, 0).expect("open");
        assert!(kept.is_empty());
        for i in 1..=5 {
            log.write(&step(i)).expect("write");
        }
        log.flush().expect("flush");
        drop(log);
        // A crash in the middle of a line.
        let mut text = std::fs::read_to_string(&path).expect("read");
        text.push_str("{\"kind\":\"step\",\"st");
        std::fs::write(&path, text).expect("write");
        let (mut log, kept) = Log::open(&path, 3, 0).expect("open again");
        assert_eq!(kept, [step(1), step(2), step(3)]);
        log.write(&step(4)).expect("write");
        log.flush().expect("flush");
        let (mut log, kept) = Log::open(&path, 9, 0).expect("open a third time");
        assert_eq!(kept.len(), 4);
        // The end of an epoch is in a checkpoint only when the next one has begun there.
        log.write(&episodes(4, 0)).expect("write");
        log.flush().expect("flush");
        let (_, kept) = Log::open(&path, 4, 1).expect("in the next epoch");
        assert_eq!(kept[4..], [episodes(4, 0)]);
        let (_, kept) = Log::open(&path, 4, 0).expect("after the last step of the epoch");
        assert_eq!(kept.len(), 4, "its end comes again");
        let (_, kept) = Log::open(&path, 0, 0).expect("a fresh run");
        assert!(kept.is_empty(), "a fresh run starts a fresh log");
    }
}

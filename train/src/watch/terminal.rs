//! The live view: a progress bar where there is a terminal, a line per epoch everywhere.

use super::record::Record;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

/// Shows records to a person on stderr.
#[derive(Debug)]
pub struct Terminal {
    bar: ProgressBar,
    epochs: u32,
    train_loss: Option<f64>,
    last: String,
}

impl Terminal {
    /// A view of a run of `total_steps`, `done` of which are done. `quiet` shows nothing.
    pub fn new(total_steps: u64, done: u64, epochs: u32, quiet: bool) -> Terminal {
        // stderr() draws only on a terminal.
        let target = if quiet { ProgressDrawTarget::hidden() } else { ProgressDrawTarget::stderr() };
        let bar = ProgressBar::with_draw_target(Some(total_steps), target).with_position(done);
        let style = ProgressStyle::with_template("{bar:24} {pos}/{len} steps  {msg}  {elapsed}, {eta} left");
        bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
        bar.reset_eta();
        Terminal { bar, epochs, train_loss: None, last: String::new() }
    }

    /// Shows a record.
    pub fn show(&mut self, record: &Record) {
        match record {
            Record::Step(s) => {
                let smooth = self.train_loss.map_or(s.loss, |old| 0.95 * old + 0.05 * s.loss);
                self.train_loss = smooth.is_finite().then_some(smooth);
                let rate = s.samples as f64 / s.seconds.max(1e-9);
                self.bar.set_position(s.step);
                self.bar.set_message(format!(
                    "epoch {}/{}  loss {smooth:.5}  {rate:.1} samples/s  {}",
                    s.epoch + 1,
                    self.epochs,
                    self.last
                ));
            }
            Record::Epoch(e) => {
                self.last = format!("regret {:.3} of random's", e.valid.relative_regret());
                self.line(&format!(
                    "epoch {:>3}/{}  loss {:.5}  validation: loss {:.5}  regret {:.4} ({:.3} of random's)  rank correlation \
                     {:.3}  hit rate {:.3}  {:.1} samples/s{}",
                    e.epoch + 1,
                    self.epochs,
                    e.train_loss,
                    e.valid_loss,
                    e.valid.regret,
                    e.valid.relative_regret(),
                    e.valid.rank_correlation,
                    e.valid.hit_rate,
                    e.samples_per_second,
                    if e.best { "  *" } else { "" }
                ));
            }
            Record::Episodes(e) => self.line(&format!(
                "  {} closed-loop episodes: coverage {:.2} %, {:.2} views to 90 % ({:.0} s)",
                e.episodes,
                100.0 * e.coverage,
                e.views_to_90,
                e.seconds
            )),
            Record::Message { text, .. } => self.line(&format!("  {text}")),
        }
    }

    /// Removes the bar.
    pub fn finish(&self) {
        self.bar.finish_and_clear();
    }

    fn line(&self, text: &str) {
        self.bar.suspend(|| tracing::info!("{text}"));
    }
}

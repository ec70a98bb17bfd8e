//! Settings of the service; `configs/service.toml` shows each at its default.

use formats::config::{SettingError, load};
use formats::{ConfigError, Flag};
use ros2::Ros2Config;
use serde::{Deserialize, Serialize};
use std::path::Path;
use std::time::Duration;

/// What the service spends on requests at most.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ServiceConfig {
    /// A request is answered, or refused, within this time after it arrived; it may ask for another.
    pub deadline_ms: u64,
    /// The longest that a request may ask for.
    pub max_deadline_ms: u64,
    /// Largest scan, body or line; other requests may have 1 MiB.
    pub body_mib: usize,
    /// Sessions open at once; none is ever dropped.
    pub sessions: usize,
    /// Scans of one session.
    pub scans: usize,
    /// What one session may hold: scans, cloud, what planners remember, answers kept for repetition.
    pub session_mib: usize,
    /// What all requests, sessions and answers together may hold.
    pub memory_mib: usize,
    /// Connections at once; above that, the one that has kept the service waiting longest is closed.
    pub connections: usize,
    /// Asked to stop, what runs may take this long.
    pub stop_ms: u64,
}

impl Default for ServiceConfig {
    fn default() -> Self {
        Self {
            deadline_ms: 30_000,
            max_deadline_ms: 120_000,
            body_mib: 64,
            sessions: 64,
            scans: 100,
            session_mib: 256,
            memory_mib: 2048,
            connections: 256,
            stop_ms: 10_000,
        }
    }
}

/// Settings of everything that serves.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ServeConfig {
    /// The service, whatever the way to it.
    pub service: ServiceConfig,
    /// The node of `--ros2`.
    pub ros2: Ros2Config,
}

impl ServeConfig {
    /// From a file, those `--set` that begin with `service.` or `ros2.`, and flags; the other `--set` are returned.
    ///
    /// # Errors
    /// As [`load`].
    pub fn load(file: Option<&Path>, set: &[String], flags: &[Flag]) -> Result<(Self, Vec<String>), ConfigError> {
        let own = |s: &String| ["service.", "ros2."].iter().any(|table| s.trim_start().starts_with(table));
        let (own, others) = set.iter().cloned().partition::<Vec<_>, _>(own);
        Ok((load(file, &own, flags)?, others))
    }
}

impl ServiceConfig {
    /// Refuses what no service can keep.
    ///
    /// # Errors
    /// The first key out of range, with what it must be.
    pub fn check(&self) -> Result<(), SettingError> {
        let (most_deadline, least_memory) = (self.max_deadline_ms, 16 * self.body_mib as u64);
        let ranges: [(&'static str, u64, std::ops::RangeInclusive<u64>, &'static str); 9] = [
            ("service.max_deadline_ms", self.max_deadline_ms, 1..=3_600_000, "1 to 3,600,000"),
            ("service.deadline_ms", self.deadline_ms, 1..=most_deadline, "1 to service.max_deadline_ms"),
            ("service.body_mib", self.body_mib as u64, 1..=1024, "1 to 1,024"),
            ("service.sessions", self.sessions as u64, 1..=10_000, "1 to 10,000"),
            ("service.scans", self.scans as u64, 1..=10_000, "1 to 10,000"),
            ("service.session_mib", self.session_mib as u64, 1..=1 << 20, "1 to 1,048,576"),
            ("service.connections", self.connections as u64, 1..=10_000, "1 to 10,000"),
            ("service.stop_ms", self.stop_ms, 0..=600_000, "0 to 600,000"),
            (
                "service.memory_mib",
                self.memory_mib as u64,
                least_memory..=1 << 20,
                "16 times service.body_mib to 1,048,576",
            ),
        ];
        for (key, found, allowed, expected) in ranges {
            if !allowed.contains(&found) {
                return Err(SettingError::new(key, found, expected));
            }
        }
        Ok(())
    }

    /// [`ServiceConfig::deadline_ms`].
    pub fn deadline(&self) -> Duration {
        Duration::from_millis(self.deadline_ms)
    }

    /// Largest body or line, bytes.
    pub fn body(&self) -> usize {
        self.body_mib << 20
    }
}

#[cfg(test)]
mod tests;

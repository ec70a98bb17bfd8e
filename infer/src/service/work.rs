//! What is asked of one session, done.

use super::answers::Kept;
use super::store::Record;
use super::{
    Answers, Asks, Entry, Held, Key, Memory, Method, OnDeadline, Patience, Refusal, Reply, Service, Store, Written,
    lock,
};
use crate::load::Loaded;
use crate::plan::Planned;
use crate::request::{Ask, Body, NextRequest, over};
use nalgebra::Point3;
use planning::scan::{FARTHEST_M, Scan};
use planning::session::Request;
use planning::{Budget, Network, Session, SessionConfig, SessionError, Stopped};
use serde::Serialize;
use serde_json::json;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::Ordering;
use std::time::Instant;

/// Places of rejected scans that a session remembers at most; the oldest are forgotten.
const PLACES: usize = 1000;

/// A session with its share of the memory and its answers; who works on it holds the lock.
pub struct Open {
    session: Session,
    held: Held,
    answers: Answers,
    /// To the request that created it.
    created: Option<Kept>,
    /// Where what is on disk counts, and has to be read before anything is asked of the session: how many of its scans have been.
    unread: Option<usize>,
    /// It is gone: whoever waited for it is told so.
    ended: bool,
}

impl Open {
    /// Without scans.
    ///
    /// # Errors
    /// Bad settings, or no memory for it.
    pub fn empty(config: SessionConfig, network: Option<Network>, memory: &Memory) -> Result<Self, Refusal> {
        let session = Session::new(config, network)?;
        let (held, answers) = (memory.nothing(), Answers::default());
        let mut open = Self { session, held, answers, created: None, unread: None, ended: false };
        open.held.resize(open.memory())?;
        Ok(open)
    }

    /// One that is on disk and read later: until then it holds nothing.
    ///
    /// # Errors
    /// Bad settings.
    pub fn on_disk(config: SessionConfig, network: Option<Network>, memory: &Memory) -> Result<Self, Refusal> {
        let session = Session::new(config, network)?;
        let (held, answers) = (memory.nothing(), Answers::default());
        Ok(Self { session, held, answers, created: None, unread: Some(0), ended: false })
    }

    /// The same with the answer to the request that created it, where that has a key.
    #[must_use]
    pub fn created_by(self, created: Option<Kept>) -> Self {
        Self { created, ..self }
    }

    /// As it goes to disk.
    pub fn record(&self) -> Record {
        let mut record = Record::new(self.session.num_scans(), self.answers.to_disk(), self.session.config());
        record.created.clone_from(&self.created);
        record.rejected_from_m = self.session.rejected_from().iter().map(|p| p.coords.into()).collect();
        record
    }

    /// After a refusal: the places of rejected scans are those `before`, and that of a scan that was just rejected; whether it was.
    fn was_rejected(&mut self, before: Vec<Point3<f64>>) -> bool {
        let now = self.session.rejected_from();
        let rejected = now.len() > before.len();
        let places = if rejected { now[now.len().saturating_sub(PLACES)..].to_vec() } else { before };
        self.session.set_rejected_from(places);
        rejected
    }

    /// It is done with: nothing is asked of it any longer.
    pub fn end(&mut self) {
        self.ended = true;
    }

    /// To ask in this program.
    pub fn session(&mut self) -> &mut Session {
        &mut self.session
    }

    /// Bytes held.
    pub fn memory(&self) -> usize {
        (1 << 20) + self.session.memory() + self.answers.memory()
    }
}

impl Service {
    /// Does what is asked of a session. Where it is refused, or fails, the session is as it was. `spare` is what it
    /// needs ([`Ask::work`]).
    ///
    /// # Errors
    /// Why it is refused.
    pub fn work(
        &self,
        entry: &Entry,
        open: &mut Open,
        ask: Ask,
        key: Option<Key>,
        patience: &Patience,
        spare: Held,
    ) -> Result<Reply, Refusal> {
        if open.ended {
            return Err(super::unknown(&entry.id.to_string()));
        }
        open.held.absorb(spare);
        let answer = self.done(entry.id, open, ask, key, patience);
        let bytes = open.memory();
        if open.held.resize(bytes).is_err() {
            tracing::debug!("an answer made a session grow beyond the available memory");
        }
        // As long as it cannot be read, those on disk count.
        if open.unread.is_none() {
            entry.scans.store(open.session.num_scans(), Ordering::Relaxed);
        }
        entry.bytes.store(bytes, Ordering::Relaxed);
        *lock(&entry.used) = Instant::now();
        answer
    }

    /// The answer to a request that is new, or what was answered before.
    fn done(
        &self,
        id: u64,
        open: &mut Open,
        ask: Ask,
        key: Option<Key>,
        patience: &Patience,
    ) -> Result<Reply, Refusal> {
        self.be_current(id, open, patience)?;
        if let Some(known) = open.answers.find(key.as_ref()) {
            return known;
        }
        let (mut ask, mut written) = (ask, None);
        if let Ask::AddScan { written: came, .. } = &mut ask {
            written = came.take();
            written.as_ref().map_or(Ok(()), |written| self.keepable(written))?;
        }
        let mutates = matches!(ask, Ask::AddScan { .. } | Ask::Undo | Ask::Reset);
        let (scans, config) = (open.session.num_scans(), open.session.config().clone());
        let places = open.session.rejected_from().to_vec();
        let attempt = catch_unwind(AssertUnwindSafe(|| self.attempt(open, ask, patience)));
        let answer = attempt.unwrap_or_else(|_| {
            let restored = catch_unwind(AssertUnwindSafe(|| open.session.restore(scans)));
            if restored.is_err() {
                open.session.reset();
            }
            Err(Refusal::internal())
        });
        let changed = mutates || *open.session.config() != config;
        if answer.is_err() && *open.session.config() != config {
            open.session.configure(config)?;
        }
        let rejected = answer.is_err() && open.was_rejected(places);
        open.answers.keep(key, &answer);
        if let Some(store) = self.store.as_ref().filter(|_| rejected || (changed && answer.is_ok())) {
            let scan = written.as_ref().filter(|_| !rejected);
            // What cannot be written is not done: the session is read anew, as it was.
            store.write(id, &open.record(), scan).inspect_err(|_| open.unread = Some(0))?;
        }
        answer
    }

    /// Refuses a scan that would be too large when the session is read again: it may have come as the name of its file.
    fn keepable(&self, Written { line, bytes, .. }: &Written) -> Result<(), Refusal> {
        let (most, mib) = (self.limits.body_mib, bytes.len().div_ceil(1 << 20));
        // A line ends with a byte more.
        if bytes.len() <= self.limits.body() + usize::from(*line) {
            return Ok(());
        }
        let message = format!(
            "the scan takes {mib} MiB in a session on disk, more than service.body_mib = {most} allows: raise it to {mib}, or thin the scan"
        );
        Err(Refusal::new(413, "too_large", message))
    }

    fn attempt(&self, open: &mut Open, ask: Ask, patience: &Patience) -> Result<Reply, Refusal> {
        match ask {
            Ask::AddScan { scan, misses_by_settings, .. } => {
                let scan = meant(*scan, misses_by_settings, open.session.config());
                self.add_scan(open, scan, patience)
            }
            Ask::NextView(request) => self.next_view(open, request, patience),
            Ask::Undo if open.session.undo() => Reply::of(&json!({ "scans": open.session.num_scans() })),
            Ask::Undo => Err(SessionError::NoScan.into()),
            Ask::Reset => {
                open.session.reset();
                Reply::of(&json!({ "scans": 0 }))
            }
            Ask::Configure(config) => {
                open.session.configure(*config)?;
                Reply::of(&json!({}))
            }
            Ask::Export => export(&open.session),
            Ask::Mesh => mesh(open, patience),
            Ask::Create(_) => Err(Refusal::internal()),
        }
    }

    fn add_scan(
        &self,
        open: &mut Open,
        Loaded { scan, reading }: Loaded,
        patience: &Patience,
    ) -> Result<Reply, Refusal> {
        let full =
            |what: String| Refusal::new(507, "session_full", format!("{what}: undo, reset or start another session"));
        let scans = open.session.num_scans();
        if scans >= self.limits.scans {
            return Err(full(format!("the session has {scans} scans, which is the maximum (service.scans)")));
        }
        let notes = reading.notes.clone();
        let report = open.session.add_scan_within(scan, reading, &patience.budget(OnDeadline::Error))?;
        let bytes = open.memory();
        let most = self.limits.session_mib;
        let fits = match bytes > most << 20 {
            true => Err(full(format!("a session may hold {most} MiB (service.session_mib)"))),
            false => open.held.cover(bytes),
        };
        if let Err(refusal) = fits {
            open.session.undo();
            return Err(refusal);
        }
        Reply::of(&json!({ "scans": open.session.num_scans(), "report": report, "notes": notes }))
    }

    fn next_view(&self, open: &mut Open, request: NextRequest, patience: &Patience) -> Result<Reply, Refusal> {
        let current_position_m = request.current_position_m;
        if current_position_m.is_some_and(|p| !p.iter().all(|x| x.abs() <= FARTHEST_M)) {
            let message = "current_position_m: farther away than a million metres";
            return Err(Refusal::new(400, "bad_position", message));
        }
        let check = match (&self.check, request.check) {
            (None, true) => {
                let message = "check: nobody can be asked here; over stdin the client is, and `infer --check-with` names a program";
                return Err(Refusal::new(400, "no_check", message));
            }
            (Some((_, Asks::WhereRequested)), false) => None,
            (check, _) => check.as_ref().map(|(check, _)| check.clone()),
        };
        if request.config.is_some() {
            let config = over(open.session.config(), request.config)?;
            super::check(&config)?;
            open.session.configure(config)?;
        }
        let budget = patience.budget(request.on_deadline);
        let answer = open.session.next_view_for(&Request { current_position_m, budget, check })?;
        match request.plan_views {
            None => Reply::of(&answer),
            Some(most) => {
                let planned = Planned::new(&open.session, &answer, most, current_position_m);
                Reply::of(&planned.map_err(|message| Refusal::new(400, "bad_plan_views", message))?)
            }
        }
    }

    /// Reads a session that has not been read, or could not be written. Where time runs out, the next request goes on from there.
    fn be_current(&self, id: u64, open: &mut Open, patience: &Patience) -> Result<(), Refusal> {
        let (Some(store), Some(before)) = (&self.store, open.unread) else { return Ok(()) };
        // Whatever ends it, it is read anew, unless it was time.
        open.unread = Some(0);
        let read = read_back(store, id, open, before, self.limits.body(), &patience.budget(OnDeadline::Error));
        if read.is_err() && open.unread == Some(0) {
            open.session.reset();
            open.held.shrink(open.memory());
        }
        read
    }
}

/// The session as it is on disk, of which the scans `before` have been read, and whose scans came in bodies of at most `most` bytes: nothing
/// is read before there is memory for it. At least one scan is read, so that repeated requests come to the end.
fn read_back(
    store: &Store,
    id: u64,
    open: &mut Open,
    before: usize,
    most: usize,
    budget: &Budget,
) -> Result<(), Refusal> {
    if before == 0 {
        open.session.reset();
    }
    open.held.cover(open.memory())?;
    let record = store.record(id)?;
    for number in before + 1..=record.scans {
        let ended = match budget.allows(false) {
            Err(Stopped::Late) if number > before + 1 => Some(Refusal::loading(number - 1, record.scans)),
            Err(Stopped::Cancelled) => Some(Refusal::stopping()),
            _ => None,
        };
        if let Some(refusal) = ended {
            open.unread = Some(number - 1);
            return Err(refusal);
        }
        let reading = super::reading(Method::AddScan, store.scan_size(id, number, most)?);
        open.held.cover(open.memory() + reading)?;
        let (config, Written { line, bytes, told }) = store.scan(id, number)?;
        let body = if line { Body::Line(&bytes) } else { Body::Whole(&bytes) };
        let refused = |why: Refusal| store.refused(id, number, why.message);
        let ask = Ask::parse(Method::AddScan, body, false, false).map_err(refused)?;
        open.held.cover(open.memory() + reading + ask.work())?;
        let Ask::AddScan { mut scan, misses_by_settings, .. } = ask else { return Err(Refusal::internal()) };
        if let Some(told) = told {
            told.lay_over(&mut scan);
        }
        let Loaded { scan, reading } = meant(*scan, misses_by_settings, &config);
        let unhurried = Budget::default();
        let configured = open.session.configure(config);
        let added = configured.and_then(|()| open.session.add_scan_within(scan, reading, &unhurried));
        added.map_err(|e| store.refused(id, number, e))?;
        open.held.cover(open.memory())?;
    }
    open.session.configure(record.config)?;
    open.session.set_rejected_from(record.rejected_from_m.into_iter().map(Point3::from).collect());
    open.answers = Answers::from_disk(record.answers);
    open.created = record.created;
    open.unread = None;
    Ok(())
}

/// A scan whose misses mean what was said, or what the settings say where it is left to them.
fn meant(mut loaded: Loaded, by_settings: bool, config: &SessionConfig) -> Loaded {
    if let (Scan::Depth { misses, .. }, true) = (&mut loaded.scan, by_settings) {
        *misses = config.misses;
    }
    loaded
}

fn export(session: &Session) -> Result<Reply, Refusal> {
    #[derive(Serialize)]
    struct Export<'a> {
        scans: usize,
        config: &'a SessionConfig,
        points_m: &'a [Point3<f64>],
        normals: &'a [nalgebra::Vector3<f64>],
        spacing_m: f64,
    }
    let cloud = session.cloud();
    Reply::of(&Export {
        scans: session.num_scans(),
        config: session.config(),
        points_m: &cloud.points,
        normals: &cloud.normals,
        spacing_m: session.state().grid_size,
    })
}

/// Memory that a mesh takes while it is made, for each point of the cloud, bytes.
const MESH: usize = 4 << 10;

fn mesh(open: &mut Open, patience: &Patience) -> Result<Reply, Refusal> {
    #[derive(Serialize)]
    struct Triangles<'a> {
        vertices_m: &'a [Point3<f64>],
        normals: &'a [nalgebra::Vector3<f64>],
        triangles: &'a [[u32; 3]],
        rim: &'a [bool],
    }
    open.held.cover(open.memory() + MESH * open.session.cloud().len())?;
    let made = open.session.mesh_within(&patience.budget(OnDeadline::Error))?;
    Reply::of(&Triangles {
        vertices_m: &made.mesh.vertices,
        normals: &made.normals,
        triangles: &made.mesh.triangles,
        rim: &made.rim,
    })
}

//! `--check-with COMMAND`: the program is started with the first question, asked over its stdin, and answers over its stdout.

use super::{Answered, LOOK, question, shown};
use planning::Budget;
use planning::session::{AskedView, Verdict, ViewCheck};
use std::collections::BTreeMap;
use std::io::{BufRead, BufReader, Read, Write};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TrySendError, sync_channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

/// Longest line that is read, bytes.
const LONGEST: u64 = 16 << 20;
/// Questions that may lie before a program that does not read.
const UNREAD: usize = 16;
/// At the end, its stdin being closed, it has so long to end itself.
const GRACE: Duration = Duration::from_millis(500);

/// A program that checks views, while it runs.
struct CheckedBy {
    command: String,
    timeout: Duration,
    running: Mutex<Option<Running>>,
}

/// Who waits for the answer to which question.
type Waiting = Arc<Mutex<Told>>;

#[derive(Default)]
struct Told {
    waiting: BTreeMap<u64, SyncSender<Result<Answered, String>>>,
    /// Nothing more comes, and why.
    ended: Option<String>,
}

/// A question that is open.
struct Question {
    number: u64,
    answer: Receiver<Result<Answered, String>>,
    /// Of the program that it was put to.
    told: Waiting,
}

struct Running {
    process: Child,
    questions: SyncSender<Vec<u8>>,
    told: Waiting,
    asked: u64,
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The check of this program, which answers a question within `timeout`. It is ended when the last copy of the check is dropped.
pub fn program(command: &str, timeout: Duration) -> ViewCheck {
    let by = CheckedBy { command: command.to_owned(), timeout, running: Mutex::default() };
    ViewCheck::new(move |views, budget| {
        by.ask(views, budget).map_err(|why| format!("--check-with '{}': {why}", by.command))
    })
}

impl CheckedBy {
    fn ask(&self, views: &[AskedView], budget: &Budget) -> Result<Vec<Verdict>, String> {
        let Question { number, answer, told } = self.put(views)?;
        let end = Instant::now() + self.timeout;
        loop {
            match answer.recv_timeout(LOOK) {
                Ok(answered) => return answered.and_then(|a| a.verdicts(views.len())),
                Err(RecvTimeoutError::Disconnected) => return Err("it was asked, and nothing came back".to_owned()),
                Err(RecvTimeoutError::Timeout) => {}
            }
            let late = Instant::now() >= end;
            if late || budget.is_spent() {
                lock(&told).waiting.remove(&number);
                let mut running = lock(&self.running);
                if late && running.as_ref().is_some_and(|running| Arc::ptr_eq(&running.told, &told)) {
                    // Whatever it waits for: the next question finds a new one.
                    *running = None;
                }
                let seconds = self.timeout.as_secs_f64();
                return Err(format!("no answer within {seconds} s (--check-timeout)"));
            }
        }
    }

    /// Asks; the answer comes later.
    fn put(&self, views: &[AskedView]) -> Result<Question, String> {
        let mut slot = lock(&self.running);
        if slot.as_ref().is_some_and(|running| lock(&running.told).ended.is_some()) {
            *slot = None;
        }
        let running = match &mut *slot {
            Some(running) => running,
            none => none.insert(start(&self.command)?),
        };
        running.asked += 1;
        let number = running.asked;
        let (sender, answer) = sync_channel(1);
        let mut told = lock(&running.told);
        match &told.ended {
            Some(why) => drop(sender.send(Err(why.clone()))),
            None => drop(told.waiting.insert(number, sender)),
        }
        drop(told);
        match running.questions.try_send(question(number, views)) {
            Err(TrySendError::Full(_)) => Err(format!("it has not read the last {UNREAD} questions")),
            // It has closed its end: what its stdout says is the reason.
            Ok(()) | Err(TrySendError::Disconnected(_)) => {
                Ok(Question { number, answer, told: Arc::clone(&running.told) })
            }
        }
    }
}

fn start(command: &str) -> Result<Running, String> {
    let (shell, flag) = if cfg!(windows) { ("cmd", "/C") } else { ("sh", "-c") };
    let mut program = Command::new(shell);
    // In a group of its own: Ctrl-C is for infer, which may have requests to answer still, and what the shell starts is ended with it.
    #[cfg(unix)]
    std::os::unix::process::CommandExt::process_group(&mut program, 0);
    let mut process = program
        .args([flag, command])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .map_err(|e| format!("it cannot be started: {e}"))?;
    let (Some(mut stdin), Some(stdout)) = (process.stdin.take(), process.stdout.take()) else {
        return Err("it has no stdin and stdout".to_owned());
    };
    let (questions, to_write) = sync_channel::<Vec<u8>>(UNREAD);
    thread::spawn(move || {
        while let Ok(line) = to_write.recv() {
            if stdin.write_all(&line).and_then(|()| stdin.flush()).is_err() {
                return;
            }
        }
    });
    let told = Waiting::default();
    let teller = Arc::clone(&told);
    thread::spawn(move || {
        let why = listen(BufReader::new(stdout), &teller);
        let mut told = lock(&teller);
        for (_, waiting) in std::mem::take(&mut told.waiting) {
            let _ = waiting.send(Err(why.clone()));
        }
        told.ended = Some(why);
    });
    Ok(Running { process, questions, told, asked: 0 })
}

/// Passes answers on until something else comes, and says what.
fn listen(mut stdout: impl BufRead, told: &Waiting) -> String {
    loop {
        let mut line = Vec::new();
        match stdout.by_ref().take(LONGEST).read_until(b'\n', &mut line) {
            Ok(0) => return "it ended, or closed its stdout, instead of answering".to_owned(),
            Err(error) => return format!("its stdout cannot be read: {error}"),
            Ok(_) if line.iter().all(u8::is_ascii_whitespace) => continue,
            Ok(_) => {}
        }
        let Some(answered) = Answered::parse(&line) else {
            return format!(
                "it wrote {:?}, expected {{\"id\": as asked, \"result\": [...]}}; what is not for infer belongs on stderr",
                shown(&String::from_utf8_lossy(&line))
            );
        };
        let mut told = lock(told);
        // An answer that nobody waits for any longer came too late.
        if let Some(waiting) = told.waiting.remove(&answered.number) {
            let _ = waiting.send(Ok(answered));
        }
    }
}

impl Drop for Running {
    /// Its stdin is closed with the questions' end; then it is waited for, and in the end killed.
    fn drop(&mut self) {
        let (closed, _) = sync_channel(0);
        drop(std::mem::replace(&mut self.questions, closed));
        let end = Instant::now() + GRACE;
        while matches!(self.process.try_wait(), Ok(None)) {
            if Instant::now() >= end {
                kill(&mut self.process);
                return;
            }
            thread::sleep(LOOK);
        }
    }
}

/// Ends the shell and what it has started.
fn kill(process: &mut Child) {
    #[cfg(unix)]
    let _ =
        Command::new("sh").args(["-c", &format!("kill -s KILL -- -{}", process.id())]).stderr(Stdio::null()).status();
    let _ = process.kill();
    let _ = process.wait();
}

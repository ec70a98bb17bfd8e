//! The open connections: no more than there is room for, none that does not take its answer.

use std::collections::BTreeMap;
use std::io::{self, IoSlice};
use std::pin::Pin;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::task::{Context, Poll, ready};
use std::time::Duration;
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::net::TcpStream;
use tokio::sync::Notify;
use tokio::time::{Sleep, sleep};

/// A client must take something of its answer within this time.
const TAKE_TIME: Duration = Duration::from_secs(20);

/// One connection.
#[derive(Default)]
pub struct Connection {
    /// A request has come in whole and is being answered.
    pub busy: AtomicBool,
    /// Told when it shall end.
    pub end: Notify,
}

type Table = BTreeMap<u64, Arc<Connection>>;

/// All of them, oldest first.
#[derive(Default)]
pub struct Connections {
    open: Mutex<(u64, Table)>,
}

/// A place among them, free again when dropped.
pub struct Place {
    connections: Arc<Connections>,
    id: u64,
    /// The connection.
    pub connection: Arc<Connection>,
}

impl Connections {
    fn table(&self) -> MutexGuard<'_, (u64, Table)> {
        self.open.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// How many there are.
    pub fn count(&self) -> usize {
        self.table().1.len()
    }

    /// A place for one more. Where there are `most`, the oldest that keeps the service waiting ends; `None` where all are being
    /// answered.
    pub fn enter(self: &Arc<Self>, most: usize) -> Option<Place> {
        let mut table = self.table();
        if table.1.len() >= most {
            let waiting = table.1.iter().find(|(_, c)| !c.busy.load(Ordering::SeqCst)).map(|(id, _)| *id)?;
            table.1.remove(&waiting)?.end.notify_one();
        }
        table.0 += 1;
        let (id, connection) = (table.0, Arc::<Connection>::default());
        table.1.insert(id, connection.clone());
        Some(Place { connections: self.clone(), id, connection })
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        self.connections.table().1.remove(&self.id);
    }
}

/// A stream that fails when its client takes nothing for too long.
pub struct Taken {
    stream: TcpStream,
    stalled: Option<Pin<Box<Sleep>>>,
}

impl Taken {
    /// This stream.
    pub fn new(stream: TcpStream) -> Self {
        Self { stream, stalled: None }
    }

    fn watch<T>(&mut self, cx: &mut Context<'_>, written: Poll<io::Result<T>>) -> Poll<io::Result<T>> {
        if written.is_ready() {
            self.stalled = None;
            return written;
        }
        let stalled = self.stalled.get_or_insert_with(|| Box::pin(sleep(TAKE_TIME)));
        ready!(stalled.as_mut().poll(cx));
        Poll::Ready(Err(io::Error::new(io::ErrorKind::TimedOut, "the client does not read its answer")))
    }
}

impl AsyncRead for Taken {
    fn poll_read(mut self: Pin<&mut Self>, cx: &mut Context<'_>, buffer: &mut ReadBuf<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_read(cx, buffer)
    }
}

impl AsyncWrite for Taken {
    fn poll_write(mut self: Pin<&mut Self>, cx: &mut Context<'_>, bytes: &[u8]) -> Poll<io::Result<usize>> {
        let written = Pin::new(&mut self.stream).poll_write(cx, bytes);
        self.watch(cx, written)
    }

    fn poll_write_vectored(
        mut self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        parts: &[IoSlice<'_>],
    ) -> Poll<io::Result<usize>> {
        let written = Pin::new(&mut self.stream).poll_write_vectored(cx, parts);
        self.watch(cx, written)
    }

    fn is_write_vectored(&self) -> bool {
        self.stream.is_write_vectored()
    }

    fn poll_flush(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_flush(cx)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_shutdown(cx)
    }
}

#[cfg(test)]
mod tests;

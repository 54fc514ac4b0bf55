//! A blob as a stream of chunks; a peer that does not read it in time loses it.

use std::pin::Pin;
use std::task::{Context, Poll};
use std::time::Duration;

use proto::BLOB_CHUNK_BYTES;
use tokio::sync::mpsc;
use tokio_stream::Stream;
use tonic::Status;

/// A reader that takes no chunk for this long is given up: 64 KiB in this time are less than any link gives.
const READ_TIMEOUT: Duration = Duration::from_secs(120);

/// The chunks of one blob.
pub struct BlobStream {
    receiver: mpsc::Receiver<Vec<u8>>,
    missing: usize,
}

impl BlobStream {
    /// Cuts `bytes`, which stay in memory, and hold their `permits` there, until they are sent or given up.
    pub fn of(bytes: Vec<u8>, permits: impl Send + 'static) -> Self {
        Self::with_timeout(bytes, permits, READ_TIMEOUT)
    }

    fn with_timeout(bytes: Vec<u8>, permits: impl Send + 'static, timeout: Duration) -> Self {
        let missing = bytes.len().div_ceil(BLOB_CHUNK_BYTES);
        // Chunks are cut when they are wanted: a slow reader holds one blob, not two.
        let (sender, receiver) = mpsc::channel(1);
        tokio::spawn(async move {
            let _held_until_sent = permits;
            for chunk in bytes.chunks(BLOB_CHUNK_BYTES) {
                let sent = sender.send(chunk.to_vec());
                if !matches!(tokio::time::timeout(timeout, sent).await, Ok(Ok(()))) {
                    return;
                }
            }
        });
        Self { receiver, missing }
    }
}

impl Stream for BlobStream {
    type Item = Result<Vec<u8>, Status>;

    fn poll_next(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<Option<Self::Item>> {
        if self.missing == 0 {
            return Poll::Ready(None);
        }
        self.receiver.poll_recv(context).map(|chunk| {
            self.missing = if chunk.is_some() { self.missing - 1 } else { 0 };
            Some(chunk.ok_or_else(|| Status::deadline_exceeded("blob: not read in time\nask for it again")))
        })
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use tokio::sync::Semaphore;
    use tokio_stream::StreamExt as _;

    use super::*;

    #[tokio::test]
    async fn all_chunks_come_and_a_reader_that_stops_frees_its_place_and_is_told() {
        let permits = Arc::new(Semaphore::new(1));
        let bytes: Vec<u8> = (0..5 * BLOB_CHUNK_BYTES + 7).map(|index| index as u8).collect();
        let permit = async || Arc::clone(&permits).acquire_owned().await.unwrap();
        let chunks = BlobStream::of(bytes.clone(), permit().await);
        let read: Vec<u8> = chunks.map(|chunk| chunk.unwrap()).collect::<Vec<_>>().await.concat();
        assert!(read == bytes);
        assert!(BlobStream::of(vec![], permit().await).next().await.is_none());

        let mut stalled = BlobStream::with_timeout(bytes, permit().await, Duration::from_millis(100));
        assert!(stalled.next().await.unwrap().is_ok());
        let _next = permit().await; // there is one only when the stalled reader has lost its own
        let rest: Vec<_> = stalled.collect().await;
        assert!(rest.last().unwrap().is_err() && rest.len() < 5);
    }
}

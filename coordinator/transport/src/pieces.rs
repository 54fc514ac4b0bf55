//! A blob on its way out, in pieces: whoever does not read what it asked for loses it.

use std::pin::Pin;
use std::task::{Context, Poll};
use std::time::Duration;

use proto::{BLOB_CHUNK_BYTES, v1};
use tokio::sync::mpsc;
use tokio_stream::Stream;
use tonic::Status;

/// A reader that takes no piece for this long is given up: 64 KiB in this time are less than any link gives.
const PATIENCE: Duration = Duration::from_secs(120);

/// The pieces of one blob.
pub struct Pieces {
    receiver: mpsc::Receiver<v1::BlobChunk>,
    missing: usize,
}

impl Pieces {
    /// Cuts `bytes`, which stay in memory, and hold their `places` there, until they are sent or given up.
    pub fn of(bytes: Vec<u8>, places: impl Send + 'static) -> Self {
        Self::with_patience(bytes, places, PATIENCE)
    }

    fn with_patience(bytes: Vec<u8>, places: impl Send + 'static, patience: Duration) -> Self {
        let missing = bytes.len().div_ceil(BLOB_CHUNK_BYTES);
        // Pieces are cut when they are wanted: a slow reader holds one blob, not two.
        let (sender, receiver) = mpsc::channel(1);
        tokio::spawn(async move {
            let _held_until_sent = places;
            for piece in bytes.chunks(BLOB_CHUNK_BYTES) {
                let sent = sender.send(v1::BlobChunk { data: piece.to_vec() });
                if !matches!(tokio::time::timeout(patience, sent).await, Ok(Ok(()))) {
                    return;
                }
            }
        });
        Self { receiver, missing }
    }
}

impl Stream for Pieces {
    type Item = Result<v1::BlobChunk, Status>;

    fn poll_next(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<Option<Self::Item>> {
        if self.missing == 0 {
            return Poll::Ready(None);
        }
        self.receiver.poll_recv(context).map(|piece| {
            self.missing = if piece.is_some() { self.missing - 1 } else { 0 };
            Some(piece.ok_or_else(|| Status::deadline_exceeded("blob: not read in time\nask for it again")))
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
    async fn all_pieces_come_and_a_reader_that_stops_frees_its_place_and_is_told() {
        let places = Arc::new(Semaphore::new(1));
        let bytes: Vec<u8> = (0..5 * BLOB_CHUNK_BYTES + 7).map(|index| index as u8).collect();
        let permit = async || Arc::clone(&places).acquire_owned().await.unwrap();
        let pieces = Pieces::of(bytes.clone(), permit().await);
        let read: Vec<u8> = pieces.map(|piece| piece.unwrap().data).collect::<Vec<_>>().await.concat();
        assert!(read == bytes);
        assert!(Pieces::of(vec![], permit().await).next().await.is_none());

        let mut stalled = Pieces::with_patience(bytes, permit().await, Duration::from_millis(100));
        assert!(stalled.next().await.unwrap().is_ok());
        let _next = permit().await; // there is one only when the stalled reader has lost its own
        let rest: Vec<_> = stalled.collect().await;
        assert!(rest.last().unwrap().is_err() && rest.len() < 5);
    }
}

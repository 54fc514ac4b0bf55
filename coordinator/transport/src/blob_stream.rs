//! A blob as a stream of chunks; a peer that does not read it in time loses it.

use std::pin::Pin;
use std::task::{Context, Poll};
use std::time::Duration;

use cluster::blobs::Blob;
use proto::BLOB_CHUNK_BYTES;
use tokio::sync::mpsc;
use tokio_stream::Stream;
use tonic::Status;

/// A reader that takes no chunk for this long is given up: 64 KiB in this time are less than any link gives.
const READ_TIMEOUT: Duration = Duration::from_secs(120);

/// A piece of a blob.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Chunk {
    /// The piece.
    pub data: Vec<u8>,
    /// If all pieces are an LZ4 block, how many bytes that holds; else 0.
    pub lz4_length: u32,
}

/// The chunks of one blob.
pub struct BlobStream {
    lz4_length: u32,
    receiver: mpsc::Receiver<Vec<u8>>,
    missing: usize,
}

impl BlobStream {
    /// Cuts a blob, which stays in memory, and holds its `permits` there, until it is sent or given up.
    pub fn of(blob: Blob, permits: impl Send + 'static) -> Self {
        Self::with_timeout(blob, permits, READ_TIMEOUT)
    }

    fn with_timeout(blob: Blob, permits: impl Send + 'static, timeout: Duration) -> Self {
        let (bytes, lz4_length) = match blob {
            Blob::Bytes(bytes) => (bytes, 0),
            Blob::Compressed(compressed) => (compressed.block().to_vec(), compressed.length()),
        };
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
        Self { lz4_length, receiver, missing }
    }
}

impl Stream for BlobStream {
    type Item = Result<Chunk, Status>;

    fn poll_next(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<Option<Self::Item>> {
        if self.missing == 0 {
            return Poll::Ready(None);
        }
        self.receiver.poll_recv(context).map(|chunk| {
            self.missing = if chunk.is_some() { self.missing - 1 } else { 0 };
            let late = || Status::deadline_exceeded("blob: not read in time\nask for it again");
            let lz4_length = self.lz4_length;
            Some(chunk.map(|data| Chunk { data, lz4_length }).ok_or_else(late))
        })
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;
    use std::sync::Arc;

    use proto::Compressed;
    use tokio::sync::Semaphore;
    use tokio_stream::StreamExt as _;

    use super::*;

    #[tokio::test]
    async fn all_chunks_come_and_a_reader_that_stops_frees_its_place_and_is_told() {
        let permits = Arc::new(Semaphore::new(1));
        let bytes: Vec<u8> = (0..5 * BLOB_CHUNK_BYTES + 7).map(|index| index as u8).collect();
        let permit = async || Arc::clone(&permits).acquire_owned().await.unwrap();
        let read = async |blob| {
            let chunks = BlobStream::of(blob, permit().await);
            let chunks: Vec<Chunk> = chunks.map(|chunk| chunk.unwrap()).collect().await;
            let lengths: BTreeSet<u32> = chunks.iter().map(|chunk| chunk.lz4_length).collect();
            (chunks.into_iter().flat_map(|chunk| chunk.data).collect::<Vec<u8>>(), lengths)
        };
        assert!(read(Blob::Bytes(bytes.clone())).await == (bytes.clone(), [0].into()));
        let compressed = Compressed::new(&bytes).unwrap();
        let sent = read(Blob::Compressed(compressed.clone())).await;
        assert!(sent == (compressed.block().to_vec(), [bytes.len() as u32].into()));
        assert!(BlobStream::of(Blob::Bytes(vec![]), permit().await).next().await.is_none());

        let mut stalled =
            BlobStream::with_timeout(Blob::Bytes(bytes), permit().await, Duration::from_millis(100));
        assert!(stalled.next().await.unwrap().is_ok());
        let _next = permit().await; // there is one only when the stalled reader has lost its own
        let rest: Vec<_> = stalled.collect().await;
        assert!(rest.last().unwrap().is_err() && rest.len() < 5);
    }
}

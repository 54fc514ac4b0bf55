//! A coordinator that has some synthetic clouds, and hands out blobs and entries only.

use std::collections::HashMap;
use std::net::SocketAddr;
use std::sync::{Arc, LazyLock, Mutex};

use descriptor::pcd::{self, DataEncoding};
use descriptor::synth::{SynthSettings, catalogue, render};
use proto::task::{CloudEntry, Label, SplitManifest};
use proto::v2::coordinator_server::{Coordinator, CoordinatorServer};
use proto::{Compressed, Digest, v2};
use tonic::transport::server::TcpIncoming;
use tonic::transport::{Endpoint, Server};
use tonic::{Request, Response, Status};

use super::bucket_server::BucketServer;
use crate::link::{Credentials, Link};
use crate::wire::Client;

/// Objects of the data set, each with two views a split.
const OBJECTS: u32 = 3;
/// Clouds in each of the three splits.
pub const SPLIT: u64 = 2 * OBJECTS as u64;
/// Clouds in all.
pub const CLOUDS: u64 = 3 * SPLIT;

/// Blobs and entries.
#[derive(Clone, Default)]
pub struct Archive {
    /// Blobs by digest.
    pub blobs: HashMap<Vec<u8>, Vec<u8>>,
    /// Entries by key.
    pub derived: Arc<Mutex<HashMap<Vec<u8>, Vec<u8>>>>,
    /// Manifests of train1, train2 and validation.
    pub splits: Vec<Digest>,
    /// Whether it compresses blobs for those who take that.
    pub compresses: bool,
    /// The bucket to which it gives URLs.
    pub bucket: Option<BucketServer>,
}

impl Archive {
    /// Three splits of synthetic clouds, and no entries.
    pub fn new() -> Self {
        Self { derived: Arc::default(), ..SYNTHETIC.clone() }
    }

    fn synthetic() -> Self {
        let settings = SynthSettings::new(OBJECTS, 6, 7).unwrap();
        let mut archive = Self::default();
        let objects = catalogue(&settings);
        for first in [0, 2, 4] {
            let views = objects.iter().flat_map(|object| [(object, first), (object, first + 1)]);
            let clouds = views.map(|(object, view)| {
                let bytes = pcd::write(&render(&settings, object, view), DataEncoding::Binary);
                CloudEntry {
                    bytes: bytes.len() as u64,
                    digest: archive.add(bytes),
                    label: Label { category: object.index % 2, instance: object.index },
                    path: object.path(view),
                    sequence: None,
                }
            });
            let clouds = clouds.collect();
            let manifest = SplitManifest { split: first.to_string(), clouds }.encode();
            let manifest = archive.add(manifest);
            archive.splits.push(manifest);
        }
        archive
    }

    /// Numbers the sequences of all clouds: each split has a view of each object in each of two.
    pub fn number_sequences(&mut self) {
        self.splits = std::mem::take(&mut self.splits)
            .into_iter()
            .map(|split| {
                let mut manifest = SplitManifest::decode(&self.blobs[&split.to_vec()]).unwrap();
                for (cloud, sequence) in manifest.clouds.iter_mut().zip([0, 1].into_iter().cycle()) {
                    cloud.sequence = Some(sequence);
                }
                self.add(manifest.encode())
            })
            .collect();
    }

    /// Adds a blob.
    pub fn add(&mut self, bytes: Vec<u8>) -> Digest {
        let digest = Digest::of(&bytes);
        self.blobs.insert(digest.to_vec(), bytes);
        digest
    }

    /// Serves it until the test ends.
    pub fn serve(self) -> Client {
        let incoming = TcpIncoming::bind(SocketAddr::from(([127, 0, 0, 1], 0))).unwrap();
        let address = incoming.local_addr().unwrap();
        tokio::spawn(
            Server::builder().add_service(CoordinatorServer::new(self)).serve_with_incoming(incoming),
        );
        let endpoint = Endpoint::from_shared(format!("http://{address}")).unwrap();
        Client::new(Link::new(endpoint.connect_lazy(), Credentials::default()))
    }
}

static SYNTHETIC: LazyLock<Archive> = LazyLock::new(Archive::synthetic);

type Chunks = futures_util::stream::Iter<std::vec::IntoIter<Result<v2::BlobChunk, Status>>>;

fn chunks(bytes: Option<&Vec<u8>>, compresses: bool) -> Result<Response<Chunks>, Status> {
    let bytes = bytes.ok_or_else(|| Status::not_found("not here"))?;
    let compressed = Compressed::new(bytes).filter(|_| compresses);
    let (bytes, lz4_length) = match &compressed {
        Some(compressed) => (compressed.block(), compressed.length()),
        None => (&bytes[..], 0),
    };
    let chunk = |data: &[u8]| Ok(v2::BlobChunk { data: data.to_vec(), lz4_length });
    let chunks: Vec<_> = bytes.chunks(proto::BLOB_CHUNK_BYTES).map(chunk).collect();
    Ok(Response::new(futures_util::stream::iter(chunks)))
}

#[tonic::async_trait]
impl Coordinator for Archive {
    type FetchBlobStream = Chunks;
    type FetchDerivedStream = Chunks;

    async fn register(&self, _: Request<v2::RegisterRequest>) -> Result<Response<v2::RegisterReply>, Status> {
        Err(Status::unimplemented("nobody registers here"))
    }

    async fn poll(&self, _: Request<v2::PollRequest>) -> Result<Response<v2::PollReply>, Status> {
        Err(Status::unimplemented("nobody polls here"))
    }

    async fn fetch_blob(&self, request: Request<v2::FetchBlobRequest>) -> Result<Response<Chunks>, Status> {
        let v2::FetchBlobRequest { digest, takes_lz4 } = request.into_inner();
        chunks(self.blobs.get(&digest), self.compresses && takes_lz4)
    }

    async fn fetch_derived(
        &self,
        request: Request<v2::FetchDerivedRequest>,
    ) -> Result<Response<Chunks>, Status> {
        chunks(self.derived.lock().unwrap().get(&request.into_inner().key), false)
    }

    async fn presign_urls(
        &self,
        request: Request<v2::PresignUrlsRequest>,
    ) -> Result<Response<v2::PresignUrlsReply>, Status> {
        let Some(bucket) = &self.bucket else { return Err(Status::unimplemented("no bucket")) };
        let (urls, sha256) = bucket.urls(&request.into_inner());
        Ok(Response::new(v2::PresignUrlsReply { urls, sha256 }))
    }
}

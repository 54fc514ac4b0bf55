//! A slow way to the coordinator: a proxy that passes everything on, but late.

use std::io::{Read as _, Write as _};
use std::net::{Shutdown, SocketAddr, TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{self, Receiver};
use std::thread;
use std::time::{Duration, Instant};

/// Something that is on its way: when it arrives, and what it is.
type Parcel = (Instant, Vec<u8>);

/// A proxy; its threads end with the connections that they serve.
pub struct Proxy {
    /// Where it listens, on loopback.
    pub address: SocketAddr,
    carried: Arc<AtomicU64>,
}

impl Proxy {
    /// A way to `target` that takes `delay` in each direction, however much travels on it.
    pub fn start(target: SocketAddr, delay: Duration) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap();
        let carried = Arc::new(AtomicU64::new(0));
        let counter = Arc::clone(&carried);
        thread::spawn(move || {
            for near in listener.incoming().map_while(Result::ok) {
                // A coordinator that has ended is met by whoever comes too late.
                let Ok(far) = TcpStream::connect(target) else { continue };
                for (from, to) in [(&near, &far), (&far, &near)] {
                    relay(from.try_clone().unwrap(), to.try_clone().unwrap(), delay, Arc::clone(&counter));
                }
            }
        });
        Self { address, carried }
    }

    /// Bytes that have arrived, in both directions.
    pub fn carried(&self) -> u64 {
        self.carried.load(Ordering::Relaxed)
    }
}

/// Carries one direction of a connection, its end included.
fn relay(mut from: TcpStream, to: TcpStream, delay: Duration, carried: Arc<AtomicU64>) {
    let (sender, parcels) = mpsc::channel::<Parcel>();
    thread::spawn(move || {
        let mut buffer = [0; 16 * 1024];
        // A reset is an end, too.
        while let Ok(length @ 1..) = from.read(&mut buffer) {
            if sender.send((Instant::now() + delay, buffer[..length].to_vec())).is_err() {
                return;
            }
        }
    });
    thread::spawn(move || deliver(parcels, to, carried));
}

fn deliver(parcels: Receiver<Parcel>, mut to: TcpStream, carried: Arc<AtomicU64>) {
    for (due, bytes) in parcels {
        thread::sleep(due.saturating_duration_since(Instant::now()));
        if to.write_all(&bytes).is_err() {
            break;
        }
        carried.fetch_add(bytes.len() as u64, Ordering::Relaxed);
    }
    let _ = to.shutdown(Shutdown::Write); // already shut when the other side has ended it
}

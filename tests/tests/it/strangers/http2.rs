//! HTTP/2 by hand, for peers that break off where no library would.

use std::io::{Read as _, Write as _};
use std::net::{Shutdown, TcpStream};

/// A poll whose message of 1000 bytes never comes.
pub fn begin_a_poll(address: &str) -> TcpStream {
    let mut stream = TcpStream::connect(address).unwrap();
    stream.write_all(b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n").unwrap();
    frame(&mut stream, 4, 0, 0, &[]); // settings
    let mut headers = vec![0x83, 0x86]; // :method POST, :scheme http (RFC 7541, appendix A)
    header(&mut headers, &[0x04], "/descry.v2.Coordinator/Poll");
    header(&mut headers, &[0x01], address);
    header(&mut headers, &[0x0f, 0x10], "application/grpc"); // content-type
    header(&mut headers, b"\x00\x02te", "trailers");
    frame(&mut stream, 1, 4, 1, &headers);
    let mut message = vec![0, 0, 0, 3, 232]; // gRPC: not compressed, 1000 bytes
    message.extend([0; 9]);
    frame(&mut stream, 0, 0, 1, &message);
    stream
}

/// Reads until the other side has ended the connection.
pub fn read_to_end(mut stream: TcpStream) -> usize {
    let mut bytes = Vec::new();
    let _ = stream.read_to_end(&mut bytes); // a reset is an end, too
    let _ = stream.shutdown(Shutdown::Both);
    bytes.len()
}

fn frame(stream: &mut TcpStream, kind: u8, flags: u8, id: u32, payload: &[u8]) {
    let length = (payload.len() as u32).to_be_bytes();
    let mut bytes = vec![length[1], length[2], length[3], kind, flags];
    bytes.extend(id.to_be_bytes());
    bytes.extend(payload);
    stream.write_all(&bytes).unwrap();
}

fn header(headers: &mut Vec<u8>, name: &[u8], value: &str) {
    headers.extend(name);
    headers.push(value.len() as u8);
    headers.extend(value.as_bytes());
}

//! Descriptions that travel compressed.

use super::*;
use crate::MAX_DESCRIPTION_BYTES;

#[test]
fn a_compressed_description_is_named_by_its_bytes_and_a_block_of_others_is_a_failure() {
    let bytes = b"bytes".repeat(100);
    let made = Described::made(bytes.clone());
    let report = |described| Report {
        lease: Lease { job: JobId(1), attempt: 1, nonce: LeaseNonce([5; 16]) },
        run_seconds: 1.0,
        outcome: Ok(TaskResult::Description(described)),
    };
    let message = v2::JobReport::from(report(made.clone()));
    assert!(message.encoded_len() < bytes.len() / 5);
    assert_eq!(Report::try_from(message), Ok(report(made.clone())));
    assert_eq!(report(made.clone()).uncompressed(), report(Described::new(bytes.clone())));
    assert!(report(made.clone()).encoded_len() > bytes.len());
    assert_eq!(made.digest, Digest::of(&bytes));

    let received = |lz4: &[u8], lz4_length| {
        Described::try_from(v2::DescriptionResult { bytes: vec![], lz4: lz4.to_vec(), lz4_length })
    };
    let block = made.compressed.as_ref().unwrap().block();
    assert_eq!(received(block, bytes.len() as u32), Ok(made.clone()));
    for (block, length) in [(block, 499), (block, 501), (&block[..9], 500), (&[9][..], 500), (block, 0)] {
        assert!(matches!(received(block, length), Err(InvalidMessage::Block(_))), "{length}");
    }
    let most = MAX_DESCRIPTION_BYTES as u32;
    assert!(matches!(received(block, most + 1), Err(InvalidMessage::TooMany { .. })));
}

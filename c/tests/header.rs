//! The header in `include` is the one that the sources make. `UPDATE_EXPECT=1` writes it.

use std::path::Path;

use expect_test::expect_file;

#[test]
fn the_header_is_that_of_the_sources() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR"));
    let config = cbindgen::Config::from_file(folder.join("cbindgen.toml")).unwrap();
    let mut builder = cbindgen::Builder::new().with_config(config);
    for source in ["status.rs", "answer.rs", "lib.rs"] {
        builder = builder.with_src(folder.join("src").join(source));
    }
    let mut header = Vec::new();
    builder.generate().unwrap().write(&mut header);
    let header = String::from_utf8(header).unwrap();
    assert!(header.matches("descry_").count() > 20, "{header}");
    expect_file![folder.join("include/descry_recognise.h")].assert_eq(&header);
}

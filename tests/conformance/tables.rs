//! CSV and WAV files whose lines and headers lie about their size.

use super::weigh::{alone, read};

#[test]
fn tables_and_sounds_allocate_no_more_than_their_limits() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    let wide = ("1,".repeat(1023) + "1\n").repeat(700);
    let endless = "0.5,1\n0.25,2\n".repeat(10) + &"1".repeat(8 << 20);
    let quoted = "0.5,1\n0.25,2\n".repeat(100_000) + "\"" + &"1,\n".repeat(2 << 20);
    let sound = |n_channels: &[u8; 2], length: &[u8; 4]| {
        let head = b"RIFF\xff\xff\xff\xffWAVEfmt \x10\0\0\0\x01\0".as_slice();
        let rate = b"\xff\xff\xff\x3b\0\0\0\0".as_slice();
        [head, n_channels, rate, b"\0\x08\x10\0data", length, &[0; 6000]].concat()
    };
    for (name, content) in [
        ("wide.csv", wide.as_bytes()),
        ("endless.csv", endless.as_bytes()),
        ("quoted.csv", quoted.as_bytes()),
        ("long.wav", &sound(b"\0\x04", b"\xff\xff\xff\xff")),
        ("many.wav", &sound(b"\xff\xff", b"\xff\xff\xff\xff")),
        ("lying.wav", &sound(b"\0\x04", b"\xff\xff\xff\x7f")),
    ] {
        let path = folder.path().join(name);
        std::fs::write(&path, content).unwrap();
        match read(&path, name) {
            Ok(_) => assert_eq!(name, "long.wav"),
            Err(error) => assert!(error.to_string().contains(name), "{error}"),
        }
    }
}

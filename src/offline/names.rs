//! Which names lead to one file: a record named twice is one record.

use std::fs;
use std::os::unix::fs::MetadataExt;
use std::path::Path;
use std::path::PathBuf;

/// Whether two names lead to one file: by another path or by links.
#[must_use]
pub fn is_same(one: &Path, other: &Path) -> bool {
    let identity = |file: &Path| fs::metadata(file).ok().map(|found| (found.dev(), found.ino()));
    one == other || identity(one).is_some_and(|of_one| identity(other) == Some(of_one))
}

/// Files that are each another one, and those that an earlier one is already, with that.
#[must_use]
pub fn distinct(files: &[PathBuf]) -> (Vec<&PathBuf>, Vec<(&PathBuf, &PathBuf)>) {
    let (mut once, mut again): (Vec<&PathBuf>, Vec<_>) = (Vec::new(), Vec::new());
    for file in files {
        match once.iter().find(|earlier| is_same(earlier, file)) {
            Some(earlier) => again.push((file, *earlier)),
            None => once.push(file),
        }
    }
    (once, again)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_file_is_one_by_whatever_path_or_link() {
        let dir = tempfile::tempdir().unwrap();
        let at = |name: &str| dir.path().join(name);
        for name in ["x.h5", "y.h5"] {
            fs::write(at(name), "the same").unwrap();
        }
        std::os::unix::fs::symlink(at("x.h5"), at("soft.h5")).unwrap();
        fs::hard_link(at("x.h5"), at("hard.h5")).unwrap();
        let names = ["x.h5", "./x.h5", "y.h5", "soft.h5", "hard.h5", "absent.h5", "absent.h5"];
        let files = names.map(at);
        let (once, again) = distinct(&files);
        assert_eq!(once, [&files[0], &files[2], &files[5]]);
        let of_x = [&files[1], &files[3], &files[4]].map(|file| (file, &files[0]));
        assert_eq!(again, [&of_x[..], &[(&files[6], &files[5])]].concat());
    }
}

//! Files given by paths, folders and patterns, in natural order: `img2.tif` before `img10.tif`.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use storage::error::{Error, Result};
use storage::walk;

/// The TIFF files of all arguments, in the order of the arguments.
pub(crate) fn of(arguments: &[PathBuf]) -> Result<Vec<PathBuf>> {
    let mut files = Vec::new();
    for argument in arguments {
        let found = if argument.is_dir() {
            listed(argument, walk::is_tiff)?
        } else {
            let pattern = argument.file_name().unwrap_or_default().to_string_lossy().into_owned();
            if pattern.contains(['*', '?']) && !argument.exists() {
                let folder = argument.parent().filter(|p| !p.as_os_str().is_empty());
                listed(folder.unwrap_or(Path::new(".")), |name| {
                    !name.starts_with('.') && walk::fits(&pattern, name)
                })?
            } else {
                vec![argument.clone()]
            }
        };
        if found.is_empty() {
            let what =
                if argument.is_dir() { "a folder without *.tif files" } else { "no file has such a name" };
            return Err(Error::input(format!("{}: {what}; expected images", argument.display())));
        }
        files.extend(found);
    }
    Ok(files)
}

/// The files of pairs in the order of pairs: the first and the second image have names, or are in folders of
/// names, that differ in a and b (or TSI's LA and LB) only, such as `img_01_a.tif` and `img_01_b.tif`. `None`
/// if no two names do.
/// Errors: a name without its partner, where others have theirs.
pub(crate) fn paired(files: &[PathBuf]) -> Result<Option<Vec<PathBuf>>> {
    let mut pairs: BTreeMap<String, [Option<usize>; 2]> = BTreeMap::new();
    for (k, file) in files.iter().enumerate() {
        if let Some((key, second)) = role(file) {
            pairs.entry(key).or_default()[second] = Some(k);
        }
    }
    let mut whole: Vec<[usize; 2]> = pairs.into_values().filter_map(|[a, b]| Some([a?, b?])).collect();
    whole.sort_unstable();
    let in_pairs: BTreeSet<usize> = whole.iter().flatten().copied().collect();
    match (0..files.len()).find(|k| !in_pairs.contains(k)) {
        _ if whole.is_empty() => Ok(None),
        None => Ok(Some(whole.iter().flatten().map(|k| files[*k].clone()).collect())),
        Some(k) => Err(Error::input(format!(
            "{}: no partner: expected names of pairs that differ in a and b only, as those of other images do",
            files[k].display()
        ))),
    }
}

/// The name of a file and its folder without the last a or b that is a word, and whether this is b.
fn role(file: &Path) -> Option<(String, usize)> {
    let folder = file.parent().and_then(Path::file_name).unwrap_or_default().to_string_lossy();
    let text = format!("{folder}/{}", file.file_stem()?.to_string_lossy());
    let (mut last, mut start) = (None, 0);
    for word in text.split_inclusive(|c: char| !c.is_alphabetic()) {
        let own = word.trim_end_matches(|c: char| !c.is_alphabetic());
        let second = ["a", "b", "la", "lb"].into_iter().position(|name| own.eq_ignore_ascii_case(name));
        last = second.map(|k| (start, own.len(), k % 2)).or(last);
        start += word.len();
    }
    let (start, length, second) = last?;
    Some((format!("{}\0{}", &text[..start], &text[start + length..]), second))
}

/// Files of a folder in natural order.
fn listed(folder: &Path, wanted: impl Fn(&str) -> bool) -> Result<Vec<PathBuf>> {
    Ok(walk::names(folder, wanted)?.into_iter().map(|name| folder.join(name)).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_are_in_natural_order() {
        let place = tempfile::tempdir().unwrap();
        for name in ["img10.tif", "img2.TIF", "img1.tiff", "notes.txt", ".img0.tif"] {
            std::fs::write(place.path().join(name), "").unwrap();
        }
        let names = |argument: &Path| -> Vec<String> {
            let name = |path: &PathBuf| path.file_name().unwrap().to_string_lossy().into_owned();
            of(&[argument.to_owned()]).unwrap().iter().map(name).collect()
        };
        assert_eq!(names(place.path()), ["img1.tiff", "img2.TIF", "img10.tif"]);
        assert_eq!(names(&place.path().join("img1*")), ["img1.tiff", "img10.tif"]);
        assert!(
            of(&[place.path().join("b*.tif")]).unwrap_err().to_string().contains("no file has such a name")
        );
    }

    #[test]
    fn files_of_pairs_are_found_by_their_names() {
        let paired = |names: &[&str]| {
            let files: Vec<PathBuf> = names.iter().map(PathBuf::from).collect();
            let text = |file: &PathBuf| file.to_string_lossy().into_owned();
            paired(&files).map(|paired| paired.map(|files| files.iter().map(text).collect::<Vec<_>>()))
        };
        for (given, expected) in [
            (
                ["a_01.tif", "a_02.tif", "b_01.tif", "b_02.tif"],
                ["a_01.tif", "b_01.tif", "a_02.tif", "b_02.tif"],
            ),
            (
                ["1.LA.tif", "1.LB.tif", "2.LA.tif", "2.LB.tif"],
                ["1.LA.tif", "1.LB.tif", "2.LA.tif", "2.LB.tif"],
            ),
            (["a/1.tif", "a/2.tif", "b/1.tif", "b/2.tif"], ["a/1.tif", "b/1.tif", "a/2.tif", "b/2.tif"]),
            (["r1B.tif", "r1A.tif", "r2B.tif", "r2A.tif"], ["r1A.tif", "r1B.tif", "r2A.tif", "r2B.tif"]),
        ] {
            assert_eq!(paired(&given).unwrap().unwrap(), expected);
        }
        for given in [["a_1.tif", "a_2.tif"], ["B1.tif", "img1.tif"]] {
            assert_eq!(paired(&given).unwrap(), None);
        }
        let message = paired(&["x_1_a.tif", "x_1_b.tif", "x_2_a.tif", "x_3_b.tif"]).unwrap_err().to_string();
        assert!(message.contains("x_2_a.tif: no partner"), "{message}");
    }
}

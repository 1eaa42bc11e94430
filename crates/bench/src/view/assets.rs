//! The page's files, embedded in the program.

use include_dir::{Dir, include_dir};

/// The folder `page/`.
pub(super) static PAGE: Dir<'static> = include_dir!("$CARGO_MANIFEST_DIR/src/view/page");

/// Content and media type of the page's file `name`.
pub(super) fn file(name: &str) -> Option<(&'static [u8], &'static str)> {
    let file = PAGE.get_file(name)?;
    let kind = match name.rsplit_once('.')?.1 {
        "html" => "text/html; charset=utf-8",
        "js" => "text/javascript; charset=utf-8",
        "css" => "text/css; charset=utf-8",
        "svg" => "image/svg+xml",
        _ => "text/plain; charset=utf-8",
    };
    Some((file.contents(), kind))
}

//! Pages that need nothing but themselves: what the reports of `bench` and `info` share.

use crate::plots::Figure;

const STYLE: &str = include_str!("page.css");

/// A page with this title and body.
pub fn document(title: &str, body: &str) -> String {
    format!(
        "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <meta name=\"color-scheme\" content=\"light dark\">\n<title>{}</title>\n\
         <style>\n{STYLE}</style>\n</head>\n<body>\n<main>\n{body}</main>\n</body>\n</html>\n",
        escape(title)
    )
}

/// A figure with its SVG, its caption, and links to the files beside the page.
pub fn figure(figure: &Figure, svg: &str) -> String {
    format!(
        "<figure id=\"{slug}\"><div class=\"plot\" role=\"img\" aria-label=\"{title}\">{svg}</div>\
         <figcaption>{caption} <a href=\"{slug}.png\">PNG</a> <a href=\"{slug}.svg\">SVG</a></figcaption></figure>",
        slug = figure.slug,
        title = escape(figure.title()),
        svg = inline(svg),
        caption = escape(&figure.caption),
    )
}

/// A table; `rows` hold what is escaped already.
pub fn table(headings: &[&str], rows: impl IntoIterator<Item = Vec<String>>) -> String {
    let head: String = headings.iter().map(|h| format!("<th>{}</th>", escape(h))).collect();
    let row = |cells: Vec<String>| -> String {
        let cells: String = cells.iter().map(|c| format!("<td>{c}</td>")).collect();
        format!("<tr>{cells}</tr>\n")
    };
    let rows: String = rows.into_iter().map(row).collect();
    format!("<div class=\"scroll\"><table><thead><tr>{head}</tr></thead><tbody>\n{rows}</tbody></table></div>")
}

pub fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// An SVG file as a part of a page: it takes the width that there is.
fn inline(svg: &str) -> String {
    let start = svg.find("<svg").unwrap_or(0);
    svg[start..].trim_end().to_owned()
}

//! Pages that need nothing but themselves: what the reports of `bench` and `info` share.

use crate::plots::Figure;
use crate::table::Table;
use maud::{DOCTYPE, Markup, PreEscaped, html};

pub fn document(title: &str, body: &Markup) -> String {
    let page = html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                meta name="color-scheme" content="light dark";
                title { (title) }
                style { (PreEscaped(include_str!("page.css"))) }
            }
            body { main { (body) } }
        }
    };
    page.into_string()
}

/// Figures with their SVG, their captions, and links to the files beside the page.
pub fn figures(drawn: &[(Figure, String)]) -> Markup {
    html! {
        section.figures {
            @for (figure, svg) in drawn {
                figure id=(figure.slug) {
                    div.plot role="img" aria-label=(figure.title) {
                        // Without its XML declaration.
                        (PreEscaped(&svg[svg.find("<svg").unwrap_or(0)..]))
                    }
                    figcaption {
                        (figure.caption) " "
                        a href={ (figure.slug) ".png" } { "PNG" } " "
                        a href={ (figure.slug) ".svg" } { "SVG" }
                    }
                }
            }
        }
    }
}

/// A table; `mark` gives the class of a row by its number, and a remark below it, which is too wide for a column.
pub fn table<'a>(table: &Table, mark: impl Fn(usize) -> (Option<&'a str>, Option<&'a str>)) -> Markup {
    let word = |column: usize| (column < table.left).then_some("word");
    html! {
        div.scroll {
            table {
                thead { tr { @for (i, heading) in table.headings.iter().enumerate() { th class=[word(i)] { (heading) } } } }
                tbody {
                    @for (row, cells) in table.rows.iter().enumerate() {
                        @let (class, remark) = mark(row);
                        tr class=[class] { @for (i, cell) in cells.iter().enumerate() { td class=[word(i)] { (cell) } } }
                        @if let Some(remark) = remark { tr.reason { td colspan=(cells.len()) { (remark) } } }
                    }
                }
            }
        }
    }
}

//! Self-contained pages: the common part of the reports of `bench` and `info`.

use crate::plots::Drawn;
use crate::table::{Table, amount};
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
            body {
                main { (body) }
                script { (PreEscaped(include_str!("page.js"))) }
            }
        }
    };
    page.into_string()
}

/// The subject of a page, and facts with headings.
pub fn about(sentence: &str, facts: &[(&str, Vec<String>)]) -> Markup {
    html! {
        p.about { (sentence) }
        dl.facts {
            @for (heading, facts) in facts { dt { (heading) } dd { @for fact in facts { p { (fact) } } } }
        }
    }
}

/// Figures with their captions, and links to the files beside the page. Each is included twice and shown once: for wide
/// pages, and for phones.
pub fn figures(drawn: &[Drawn]) -> Markup {
    html! {
        section.figures {
            @for Drawn { figure, wide, narrow } in drawn {
                figure id=(figure.slug) {
                    @for (class, svg) in [("plot wide", wide), ("plot narrow", narrow)] {
                        div class=(class) role="img" aria-label=(figure.title) {
                            // The XML declaration is removed.
                            (PreEscaped(&svg[svg.find("<svg").unwrap_or(0)..]))
                        }
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

/// A table called `label`, which the page's script sorts by a column. `mark` gives the class of a row by its number,
/// and a remark to show below it, too wide for a column. Cells other than plain numbers state their value.
pub fn table<'a>(label: &str, table: &Table, mark: impl Fn(usize) -> (Option<&'a str>, Option<&'a str>)) -> Markup {
    let word = |column: usize| (column < table.left).then_some("word");
    // In JavaScript's notation.
    let number = |n: f64| if n.is_infinite() { "Infinity".to_owned() } else { n.to_string() };
    html! {
        // Boxes that scroll are focusable, so that arrow keys scroll them.
        div.scroll tabindex="0" role="region" aria-label=(label) {
            table.sortable {
                thead {
                    tr {
                        @for (i, heading) in table.headings.iter().enumerate() {
                            th scope="col" class=[word(i)] { (heading) }
                        }
                    }
                }
                tbody {
                    @for (row, cells) in table.rows.iter().enumerate() {
                        @let (class, remark) = mark(row);
                        tr class=[class] {
                            @for (i, cell) in cells.iter().enumerate() {
                                td class=[word(i)] data-n=[amount(cell).map(number)] { (cell) }
                            }
                        }
                        @if let Some(remark) = remark { tr.reason { td colspan=(cells.len()) { (remark) } } }
                    }
                }
            }
        }
    }
}

"""A document of headings, text, tables and pictures, written as one HTML file and as Markdown."""
import base64
import html
import pathlib

STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; margin: 2rem auto; max-width: 76rem; padding: 0 1rem;
       color: #222; background: #fff }
h1, h2, h3 { line-height: 1.2 } h2 { margin-top: 2.5rem; border-bottom: 1px solid #ddd }
table { border-collapse: collapse; margin: .5rem 0 1.5rem; font-size: 12.5px; display: block;
        overflow-x: auto }
caption { text-align: left; font-weight: 600; padding-bottom: .3rem }
th, td { padding: .2rem .45rem; text-align: right; border-bottom: 1px solid #e5e5e5;
         white-space: nowrap }
th:first-child, td:first-child { text-align: left } thead th { border-bottom: 2px solid #888 }
figure { display: inline-block; margin: .5rem 1rem 1rem 0; vertical-align: top; max-width: 100% }
figure img { max-width: 100%; display: block }
figure.half { max-width: calc(50% - 1.2rem) } figcaption { font-size: 13px; color: #555 }
"""


class Document:
    """Collects blocks in their order. The HTML file needs no other files."""

    def __init__(self, title):
        self.title = title
        self.html = [f"<h1>{html.escape(title)}</h1>"]
        self.markdown = [f"# {title}"]
        self.files = {}

    def heading(self, text, level=2):
        self.html.append(f"<h{level}>{html.escape(text)}</h{level}>")
        self.markdown.append("#" * level + " " + text)

    def text(self, text):
        self.html.append(f"<p>{html.escape(text)}</p>")
        self.markdown.append(text)

    def items(self, texts):
        self.html.append("<ul>" + "".join(f"<li>{html.escape(t)}</li>" for t in texts) + "</ul>")
        self.markdown.append("\n".join(f"- {t}" for t in texts))

    def table(self, caption, header, rows):
        cells = [[str(c) for c in row] for row in rows]
        head = "".join(f"<th>{html.escape(c)}</th>" for c in header)
        body = "\n".join("<tr>" + "".join(f"<td>{html.escape(c)}</td>" for c in row) + "</tr>"
                         for row in cells)
        self.html.append(f"<table><caption>{html.escape(caption)}</caption>"
                         f"<thead><tr>{head}</tr></thead>\n<tbody>{body}</tbody></table>")
        lines = ["| " + " | ".join(header) + " |",
                 "|---" + "|---:" * (len(header) - 1) + "|"]
        lines += ["| " + " | ".join(row) + " |" for row in cells]
        self.markdown.append(f"**{caption}**\n\n" + "\n".join(lines))

    def picture(self, name, caption, data, half=False):
        """Adds a picture. `name`: name of the file beside the Markdown, ending in .svg or .jpg. `half`: whether it
        takes half of the width."""
        kind = {"svg": "svg+xml", "jpg": "jpeg"}[name.rsplit(".", 1)[1]]
        source = f"data:image/{kind};base64,{base64.b64encode(data).decode()}"
        attribute = ' class="half"' if half else ""
        self.html.append(f'<figure{attribute}><img src="{source}" alt="{html.escape(caption)}">'
                         f"<figcaption>{html.escape(caption)}</figcaption></figure>")
        self.markdown.append(f"![{caption}](figures/{name})\n\n{caption}")
        self.files[name] = data

    def write(self, folder):
        """Writes index.html, report.md and, for report.md, the folder figures/."""
        folder = pathlib.Path(folder)
        (folder / "figures").mkdir(parents=True, exist_ok=True)
        page = ("<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">"
                "<meta name=\"viewport\" content=\"width=device-width\">"
                "<link rel=\"icon\" href=\"data:,\">"
                f"<title>{html.escape(self.title)}</title><style>{STYLE}</style></head>\n<body>\n"
                + "\n".join(self.html) + "\n</body></html>\n")
        (folder / "index.html").write_text(page, encoding="utf-8")
        (folder / "report.md").write_text("\n\n".join(self.markdown) + "\n", encoding="utf-8")
        for name, data in self.files.items():
            (folder / "figures" / name).write_bytes(data)

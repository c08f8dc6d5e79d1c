//! Linking of the page's modules into few scripts.
//!
//! The first script of a page holds all modules that it imports. A module that it imports later, with
//! `await import("./x.js")`, begins another script, which imports shared modules from the first one. Each module
//! becomes a function with a scope: `const $dom = (() => { …; return { h, svg }; })();`. Modules must not import each
//! other in a circle, and use the one form of imports and exports that the page has.

use std::collections::{BTreeMap, BTreeSet};

/// A module: its imports by line, and the rest of its source.
#[derive(Debug)]
struct Module {
    /// Names of the modules that it imports, in order.
    imports: Vec<String>,
    /// Names of the modules that it imports later.
    later: Vec<String>,
    /// Names of its exports.
    exports: Vec<String>,
    /// Its source without comments and without the keywords of modules.
    body: String,
}

/// Modules by name, without `.js`.
pub struct Modules(BTreeMap<String, Module>);

const LATER: &str = "await import(\"./";

impl Modules {
    /// Reads modules: pairs of name and source.
    pub fn read<'a>(sources: impl IntoIterator<Item = (&'a str, &'a str)>) -> Self {
        Self(sources.into_iter().map(|(name, source)| (name.to_owned(), Module::read(source))).collect())
    }

    /// Links a module and all that it needs into one script, which defines `$NAME`.
    pub fn whole(&self, entry: &str) -> String {
        let mut order = vec![];
        self.order(entry, &|module| module.imports.iter().chain(&module.later).collect(), &mut order);
        let here = order.iter().copied().collect();
        order.iter().map(|name| self.text(name, &here)).collect()
    }

    /// Links a page that starts with a module: its scripts by name.
    pub fn page(&self, entry: &str) -> BTreeMap<String, String> {
        let parts = self.parts(entry);
        let first: BTreeSet<&str> = parts[entry].iter().copied().collect();
        let linked = parts.iter().map(|(part, modules)| {
            let here: BTreeSet<&str> = modules.iter().copied().collect();
            let from = |source: &str, wanted: &BTreeSet<&str>| match wanted.is_empty() {
                true => String::new(),
                false => format!("import {{ {} }} from \"./{source}.js\";\n", names(wanted)),
            };
            let imports = modules.iter().filter_map(|name| self.0.get(*name)).flat_map(|module| &module.imports);
            let outside: BTreeSet<&str> = imports.map(String::as_str).filter(|name| !here.contains(name)).collect();
            let mut text = from(entry, &outside.intersection(&first).copied().collect());
            text.extend(outside.difference(&first).map(|other| from(other, &[*other].into())));
            text.extend(modules.iter().map(|name| self.text(name, &here)));
            let exports = if *part == entry { names(&first) } else { format!("${part}") };
            ((*part).to_owned(), text + &format!("export {{ {exports} }};\n"))
        });
        linked.collect()
    }

    /// Modules of each script of a page, in the order in which they run. Modules that several scripts need belong to
    /// the first one.
    fn parts<'a>(&'a self, entry: &'a str) -> BTreeMap<&'a str, Vec<&'a str>> {
        let all = {
            let mut all = vec![];
            self.order(entry, &|module| module.imports.iter().chain(&module.later).collect(), &mut all);
            all
        };
        let mut roots = vec![entry];
        loop {
            let mut first = vec![];
            roots.iter().for_each(|root| self.order(root, &|module| module.imports.iter().collect(), &mut first));
            let later = all.iter().filter_map(|name| self.0.get(*name)).flat_map(|module| &module.later);
            let starts: BTreeSet<&str> = later.map(String::as_str).filter(|name| !first.contains(name)).collect();
            let part = |start: &'a str| {
                let mut part = vec![];
                let inside = |name: &&String| !first.contains(&name.as_str()) && !starts.contains(name.as_str());
                self.order(start, &|module| module.imports.iter().filter(inside).collect(), &mut part);
                (start, part)
            };
            let mut parts: BTreeMap<&str, Vec<&str>> = starts.iter().map(|start| part(start)).collect();
            let mut seen = BTreeSet::new();
            let shared: Vec<&str> = parts.values().flatten().filter(|name| !seen.insert(**name)).copied().collect();
            if shared.is_empty() {
                // The entry runs last: it uses all others.
                first.retain(|name| *name != entry);
                first.push(entry);
                parts.insert(entry, first);
                return parts;
            }
            roots.extend(shared);
        }
    }

    /// Appends a module and those that it needs to a list, each after those that it needs.
    fn order<'a>(&'a self, name: &'a str, needs: &impl Fn(&'a Module) -> Vec<&'a String>, list: &mut Vec<&'a str>) {
        fn visit<'a>(
            modules: &'a Modules,
            name: &'a str,
            needs: &impl Fn(&'a Module) -> Vec<&'a String>,
            seen: &mut BTreeSet<&'a str>,
            list: &mut Vec<&'a str>,
        ) {
            let Some(module) = modules.0.get(name) else { return };
            if seen.insert(name) {
                needs(module).into_iter().for_each(|needed| visit(modules, needed, needs, seen, list));
                list.push(name);
            }
        }
        visit(self, name, needs, &mut list.iter().copied().collect(), list);
    }

    /// A module as a function, in a script with the modules `here`.
    fn text(&self, name: &str, here: &BTreeSet<&str>) -> String {
        let Some(module) = self.0.get(name) else { return String::new() };
        let mut body = module.body.clone();
        for later in &module.later {
            let there = format!("(await import(\"./{later}.js\")).${later}");
            let found = if here.contains(later.as_str()) { format!("${later}") } else { there };
            body = body.replace(&format!("{LATER}{later}.js\")"), &found);
        }
        format!("const ${name} = (() => {{\n{body}return {{ {} }};\n}})();\n", module.exports.join(", "))
    }
}

fn names(modules: &BTreeSet<&str>) -> String {
    modules.iter().map(|name| format!("${name}")).collect::<Vec<_>>().join(", ")
}

impl Module {
    fn read(source: &str) -> Self {
        let mut module = Self { imports: vec![], later: vec![], exports: vec![], body: String::new() };
        for line in code(source) {
            if let Some((wanted, from)) = import(line) {
                module.body += &format!("const {{ {} }} = ${from};\n", wanted.replace(" as ", ": "));
                module.imports.push(from.to_owned());
                continue;
            }
            let exported = line.strip_prefix("export ");
            module.exports.extend(exported.and_then(declared).map(str::to_owned));
            for later in line.split(LATER).skip(1).filter_map(|rest| rest.split_once(".js\")")) {
                module.later.push(later.0.to_owned());
            }
            module.body += exported.unwrap_or(line);
            module.body.push('\n');
        }
        module
    }
}

/// Lines without those that hold comments only, and without indentation.
fn code(source: &str) -> impl Iterator<Item = &str> {
    let mut comment = false;
    source.lines().map(str::trim).filter(move |line| {
        let before = comment;
        comment = (comment || line.starts_with("/*")) && !line.contains("*/");
        let only = before || comment || (line.starts_with("/*") && line.ends_with("*/")) || line.starts_with("//");
        !only && !line.is_empty()
    })
}

/// The names and the module of a line `import { a, b as c } from "./x.js";`.
fn import(line: &str) -> Option<(&str, &str)> {
    line.strip_prefix("import { ")?.strip_suffix(".js\";")?.split_once(" } from \"./")
}

/// The name that `function f(…`, `async function f(…`, `class C …` or `const c …` declares.
fn declared(line: &str) -> Option<&str> {
    let rest = ["async function ", "function ", "class ", "const "].iter().find_map(|kind| line.strip_prefix(kind))?;
    rest.split(|c: char| !c.is_alphanumeric() && c != '_' && c != '$').next().filter(|name| !name.is_empty())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::{scripts, text};

    #[test]
    fn modules_have_the_form_that_is_linked() {
        for (path, name) in scripts() {
            let source = text(path);
            assert!(name.bytes().all(|b| b.is_ascii_lowercase()), "{path}: a name of letters a to z is needed");
            for (k, line) in source.lines().enumerate() {
                let at = format!("{path}, line {}: {line}", k + 1);
                assert!(
                    !line.starts_with("import") || import(line).is_some(),
                    "{at}: import {{ a, b as c }} from \"./x.js\"; is linked"
                );
                let export = line.strip_prefix("export").map(|rest| declared(rest.trim_start()));
                assert_ne!(export, Some(None), "{at}: functions, classes and const are exported");
                assert!(!line.contains("import.meta") && !line.starts_with("await "), "{at}: is not linked");
            }
            for line in code(source) {
                let whole = line.matches('`').count() % 2 == 0;
                assert!(whole, "{path}: {line}: a template over several lines would lose its indentation");
                // Types in comments are named by imports, too.
                let dynamic = line.matches("import(\"./").count() - line.matches("{import(\"./").count();
                let linked = line.matches(LATER).count();
                assert_eq!(dynamic, linked, "{path}: {line}: await import(\"./x.js\") is linked");
            }
        }
    }

    #[test]
    fn no_modules_import_each_other() {
        let modules = crate::modules();
        for page in ["app", "display", "standalone"] {
            let mut order = vec![];
            modules.order(page, &|module| module.imports.iter().collect(), &mut order);
            for (k, name) in order.iter().enumerate() {
                let known = modules.0[*name].imports.iter().all(|needed| order[..k].contains(&needed.as_str()));
                assert!(known, "{name} imports a module that imports it");
            }
        }
    }

    #[test]
    fn shared_modules_run_once() {
        let modules = Modules::read([
            (
                "app",
                "import { a as b } from \"./a.js\";\n// said\nconst v = async () => (await import(\"./view.js\")).v(b);\n",
            ),
            ("a", "/** A.\n * more */\nexport const a = 1;\n"),
            ("view", "import { a } from \"./a.js\";\nimport { s } from \"./shared.js\";\nexport function v() {}\n"),
            (
                "map",
                "import { s } from \"./shared.js\";\nimport { v } from \"./view.js\";\nexport class M {}\nconst t = await import(\"./view.js\");",
            ),
            ("other", "export const o = await import(\"./map.js\");\n"),
            ("shared", "export const s = 2;\n"),
        ]);
        assert_eq!(modules.page("app").keys().collect::<Vec<_>>(), ["app", "view"]);
        let page = modules.page("app");
        assert_eq!(
            page["app"],
            "const $a = (() => {\nconst a = 1;\nreturn { a };\n})();\nconst $app = (() => {\nconst { a: b } = $a;\n\
             const v = async () => ((await import(\"./view.js\")).$view).v(b);\nreturn {  };\n})();\nexport { $a, $app };\n"
        );
        assert!(page["view"].starts_with("import { $a } from \"./app.js\";\nconst $shared = "), "{}", page["view"]);
        assert!(page["view"].ends_with("export { $view };\n"));
        let both = Modules::read([
            ("app", "await import(\"./view.js\");\nawait import(\"./map.js\");"),
            ("view", "import { s } from \"./shared.js\";\nexport function v() {}\n"),
            ("map", "import { s } from \"./shared.js\";\nimport { v } from \"./view.js\";\n"),
            ("shared", "export const s = 2;\n"),
        ]);
        let page = both.page("app");
        assert!(page["app"].contains("$shared = ") && !page["view"].contains("$shared = "), "{page:?}");
        assert!(
            page["map"].contains("import { $shared } from \"./app.js\";\nimport { $view } from \"./view.js\";"),
            "{page:?}"
        );
        let whole = modules.whole("other");
        assert!(whole.find("$view = ") < whole.find("$map = ") && whole.contains("o = $map;"), "{whole}");
    }
}

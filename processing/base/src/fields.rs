//! Options of an operation, derived from its JSON Schema, for command lines and forms.

#[cfg(test)]
mod tests;
mod text;

use serde_json::{Map, Value};
use text::{read, words};

/// Schema key: list of aliases of the flag.
pub const ALIASES: &str = "x-aliases";

/// Schema key: placeholder of the value in help, such as `WxH`.
pub const PLACEHOLDER: &str = "x-placeholder";

/// Schema key: true for an option that names a file. A command line reads the file if the option is an object; a
/// service accepts names of uploaded files.
pub const FILE: &str = "x-file";

/// Schema key: the word that leaves an option to the program, such as `auto`.
pub const UNSET: &str = "x-unset";

/// Schema key: true for an option that is rarely needed.
pub const ADVANCED: &str = "x-advanced";

/// Schema key: true for an option of requests to the service, which has no flag.
pub const REQUEST: &str = "x-request";

/// Schema key of a variant with a value: the value if only the variant's name is given.
pub const BARE: &str = "x-bare";

/// Schema key of a variant with a value: true if a value without a name selects this variant.
pub const NAMELESS: &str = "x-nameless";

/// Schema key: the flag, if it differs from the key's name.
pub const FLAG: &str = "x-flag";

/// Schema key of a structure: true if the flags of its options do not begin with its name.
pub const INLINE: &str = "x-inline";

/// Schema key of variants with values: true if each has a separate flag, such as `--psf-sigma` for `{"psf": {"sigma":
/// 2}}`.
pub const EXPAND: &str = "x-expand";

/// Schema key of a structure: true if its values are given as a list, in the order of its keys.
pub const LIST: &str = "x-list";

/// Schema key of a list: true if values omitted at its end take those of the default.
pub const SHORT: &str = "x-short";

/// Schema key: the variant selected by a CSV file, whose rows are numbers.
pub const TABLE: &str = "x-table";

/// Schema key (of JSON Schema) for accepted words besides file names, such as built-in illuminants.
pub const EXAMPLE_WORDS: &str = "examples";

/// Schema key of all options: description of the input.
pub const INPUT: &str = "x-input";

/// Schema key of all options: example command lines, and the output files of the operation.
pub const EXAMPLES: &str = "x-examples";

/// An option.
#[derive(Clone, Debug, PartialEq)]
pub struct Field {
    /// Keys that lead to the option; more than one within nested structures.
    pub path: Vec<String>,
    /// Schema of the option without references, and without `null` as a type.
    pub schema: Map<String, Value>,
    /// True if the option must be given.
    pub required: bool,
    /// Number of leading keys that are omitted from its name.
    unnamed: usize,
    /// For an option of one variant: the number of leading keys up to the variant's name.
    pub variant: Option<usize>,
}

/// All options of an operation.
#[derive(Clone, Debug, PartialEq)]
pub struct Fields {
    root: Value,
    /// The options, in the order of their structure.
    pub list: Vec<Field>,
}

impl Fields {
    /// From a schema with its definitions.
    pub fn of(root: Value) -> Self {
        let mut list = vec![];
        if let Some(schema) = root.as_object() {
            collect(&root, schema, &Place::default(), &mut list);
        }
        Self { root, list }
    }

    /// The whole schema, with its definitions.
    pub fn schema(&self) -> &Value {
        &self.root
    }

    /// A text of the whole schema, such as [`EXAMPLES`]; empty if missing.
    pub fn text(&self, key: &str) -> &str {
        self.root[key].as_str().unwrap_or_default()
    }
}

/// Position of a structure among the options.
#[derive(Clone, Default)]
struct Place {
    path: Vec<String>,
    unnamed: usize,
    variant: Option<usize>,
    advanced: bool,
}

impl Place {
    fn then(&self, key: &str) -> Self {
        let path = self.path.iter().map(String::as_str).chain([key]).map(str::to_owned).collect();
        Self { path, ..self.clone() }
    }
}

/// Collects the options of a structure. Nested structures and variants that are not read from a file are replaced by
/// their options.
fn collect(root: &Value, structure: &Map<String, Value>, at: &Place, list: &mut Vec<Field>) {
    let required = structure.get("required").and_then(Value::as_array);
    for (key, property) in structure.get("properties").and_then(Value::as_object).into_iter().flatten() {
        let needed = at.path.is_empty() && required.is_some_and(|all| all.iter().any(|name| name == key));
        option(root, resolved(root, property), at.then(key), needed, list);
    }
}

/// Collects one option, or the options nested in it.
fn option(root: &Value, mut schema: Map<String, Value>, mut at: Place, required: bool, list: &mut Vec<Field>) {
    at.advanced |= is_set(&schema, ADVANCED);
    if is_set(&schema, INLINE) {
        at.unnamed = at.path.len();
    }
    if schema.contains_key("properties") && !is_set(&schema, FILE) && !is_set(&schema, LIST) {
        return collect(root, &schema, &at, list);
    }
    if let (true, Some(Value::Array(all))) = (is_set(&schema, EXPAND), schema.get("oneOf")) {
        at.variant = Some(at.path.len());
        for one in all.iter().filter_map(Value::as_object) {
            let Some((key, inner)) = one.get("properties").and_then(Value::as_object).and_then(|all| all.iter().next())
            else {
                continue;
            };
            let mut own = one.clone();
            ["type", "properties", "required", "additionalProperties"].iter().for_each(|key| drop(own.remove(*key)));
            merge(&mut own, resolved(root, inner));
            option(root, own, at.then(key), false, list);
        }
        return;
    }
    if is_set(&schema, REQUEST) {
        return;
    }
    if at.advanced {
        schema.insert(ADVANCED.into(), true.into());
    }
    list.push(Field { path: at.path, schema, required, unnamed: at.unnamed, variant: at.variant });
}

fn is_set(schema: &Map<String, Value>, key: &str) -> bool {
    schema.get(key) == Some(&Value::Bool(true))
}

/// Schema with references resolved and without `null`. Keys beside a reference take precedence.
fn resolved(root: &Value, schema: &Value) -> Map<String, Value> {
    let mut schema = schema.as_object().cloned().unwrap_or_default();
    if let Some(Value::String(name)) = schema.remove("$ref") {
        merge(&mut schema, resolved(root, root.pointer(name.trim_start_matches('#')).unwrap_or(&Value::Null)));
    }
    if let Some(Value::Array(types)) = schema.get_mut("type") {
        types.retain(|name| name != "null");
        if let [one] = types.as_slice() {
            let one = one.clone();
            schema.insert("type".into(), one);
        }
    }
    for key in ["anyOf", "oneOf"] {
        let Some(Value::Array(all)) = schema.remove(key) else { continue };
        let all = all.iter().map(|one| resolved(root, one)).filter(|one| one.get("type").is_none_or(|t| t != "null"));
        let mut all: Vec<_> = all.collect();
        if all.len() == 1 {
            merge(&mut schema, all.swap_remove(0));
        } else {
            schema.insert(key.into(), all.into());
        }
    }
    schema
}

fn merge(schema: &mut Map<String, Value>, other: Map<String, Value>) {
    for (key, value) in other {
        schema.entry(key).or_insert(value);
    }
}

impl Field {
    /// A text of the option's schema.
    pub fn text(&self, key: &str) -> Option<&str> {
        self.schema.get(key).and_then(Value::as_str)
    }

    /// True if the option names a file.
    pub fn is_file(&self) -> bool {
        is_set(&self.schema, FILE)
    }

    /// Name with dashes, as used by command lines and forms: `light-scale` for `scale` in `light`, `light` for `path`
    /// in it, and `no-accelerate` for a switch that is on by default.
    pub fn name(&self) -> String {
        if let Some(stated) = self.text(FLAG) {
            return stated.into();
        }
        let keys = &self.path[self.unnamed..];
        let last = keys.len() - 1;
        let keys = keys.iter().enumerate().filter(|(k, key)| *k == 0 || *k < last || *key != "path");
        let name = keys.map(|(_, key)| key.replace('_', "-")).collect::<Vec<_>>().join("-");
        if self.is_on() { format!("no-{name}") } else { name }
    }

    /// True for a switch that is on by default.
    pub fn is_on(&self) -> bool {
        self.is_flag() && self.default() == Some(&Value::Bool(true))
    }

    /// True if the option and another one belong to mutually exclusive variants.
    pub fn excludes(&self, other: &Self) -> bool {
        self.variant.is_some_and(|at| {
            other.variant == Some(at) && self.path[..at] == other.path[..at] && self.path[at] != other.path[at]
        })
    }

    /// Aliases of the option.
    pub fn aliases(&self) -> Vec<String> {
        let all = self.schema.get(ALIASES).and_then(Value::as_array);
        all.into_iter().flatten().filter_map(|name| name.as_str().map(str::to_owned)).collect()
    }

    /// Default value; `None` if it is left to the program.
    pub fn default(&self) -> Option<&Value> {
        self.schema.get("default").filter(|value| !value.is_null())
    }

    /// True if the option is rarely needed.
    pub fn is_advanced(&self) -> bool {
        is_set(&self.schema, ADVANCED)
    }

    /// True for a boolean option.
    pub fn is_flag(&self) -> bool {
        self.text("type") == Some("boolean")
    }

    /// True if the value is a structure.
    pub fn is_structure(&self) -> bool {
        let structure = |schema: &Map<String, Value>| schema.contains_key("properties");
        let alternatives = self.schema.get("anyOf").and_then(Value::as_array);
        structure(&self.schema)
            || alternatives.is_some_and(|all| all.iter().filter_map(Value::as_object).all(structure))
    }

    /// Accepted words, if the option accepts nothing else.
    pub fn words(&self) -> Option<Vec<String>> {
        words(&self.schema)
    }

    /// Placeholder of the value: as stated in the schema, the accepted words, or the unit at the end of its name.
    pub fn placeholder(&self) -> String {
        if let Some(stated) = self.text(PLACEHOLDER) {
            return stated.into();
        }
        if let Some(words) = self.words() {
            return words.join("|").replace('_', "-");
        }
        let unit = self.path.last().and_then(|key| key.rsplit_once('_')).map(|(_, unit)| unit);
        match (self.is_file(), unit, self.text("type")) {
            (true, ..) => "FILE".into(),
            (_, Some(unit @ ("nm" | "um" | "mm" | "m" | "deg" | "px")), _) => unit.to_uppercase(),
            (_, _, Some("integer")) => "N".into(),
            (_, _, Some("number")) => "NUMBER".into(),
            _ => "VALUE".into(),
        }
    }

    /// Expected kind of text, for messages.
    pub fn expected(&self) -> String {
        let placeholder = self.placeholder();
        match (self.text("type"), self.schema.get("minItems").and_then(Value::as_u64)) {
            (Some("array"), Some(2)) => format!("two numbers: {placeholder}"),
            (Some("array"), Some(count)) => format!("{count} numbers or lists of numbers: {placeholder}"),
            (Some("number"), _) => "a number".into(),
            (Some("integer"), _) => "a whole number".into(),
            _ => placeholder,
        }
    }

    /// Parses a text as a value.
    ///
    /// # Errors
    /// The accepted values.
    pub fn value(&self, text: &str) -> Result<Value, String> {
        if self.text(UNSET) == Some(text) {
            return Ok(Value::Null);
        }
        read(&self.schema, text).ok_or_else(|| match self.text("type") {
            Some("number") => format!("{text:?} is no number"),
            Some("integer") => format!("{text:?} is no whole number"),
            _ => format!("{text:?} is no {}", self.placeholder()),
        })
    }

    /// Inserts a value at the option's position in the JSON options.
    pub fn put(&self, options: &mut Value, value: Value) {
        let place = self.path.iter().fold(options, |at, key| {
            if !at.is_object() {
                *at = Value::Object(Map::new());
            }
            &mut at[key.as_str()]
        });
        *place = value;
    }

    /// The file name among JSON options: the option's value, or that of a variant that names a file.
    pub fn file<'a>(&self, options: &'a mut Value) -> Option<&'a mut Value> {
        let variants = self.schema.get("oneOf").and_then(Value::as_array);
        let variants = variants.into_iter().flatten().filter_map(Value::as_object).filter(|one| is_set(one, FILE));
        let keys: Vec<&String> = variants.filter_map(|one| one.get("properties")?.as_object()?.keys().next()).collect();
        let value = self.path.iter().try_fold(options, |at, key| at.get_mut(key))?;
        if self.is_file() {
            return Some(value);
        }
        let given = value.as_object_mut()?;
        given.iter_mut().find(|(key, _)| keys.contains(key)).map(|(_, name)| name)
    }

    /// True if a word is one of the built-in values besides file names.
    pub fn is_built_in(&self, word: &str) -> bool {
        let words = self.schema.get(EXAMPLE_WORDS).and_then(Value::as_array);
        words.into_iter().flatten().any(|known| known == word)
    }

    /// The option's value among JSON options, if given.
    pub fn get<'a>(&self, options: &'a Value) -> Option<&'a Value> {
        self.path.iter().try_fold(options, |at, key| at.get(key))
    }
}

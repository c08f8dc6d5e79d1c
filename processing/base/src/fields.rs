//! Options of an operation as its JSON Schema describes them, for command lines and forms.

use serde_json::{Map, Value};

/// Schema key: other names of the flag, a list of strings.
pub const ALIASES: &str = "x-aliases";

/// Schema key: placeholder of the value in help, such as `WxH`.
pub const PLACEHOLDER: &str = "x-placeholder";

/// Schema key: true for an option that names a file. A command line reads the file where the option is an object; a service takes names of
/// uploaded files.
pub const FILE: &str = "x-file";

/// Schema key: the word for an option that is left to the program, such as `auto`.
pub const UNSET: &str = "x-unset";

/// Schema key: true for an option that few need.
pub const ADVANCED: &str = "x-advanced";

/// Schema key of a variant with a value: the value if only its name is given.
pub const BARE: &str = "x-bare";

/// Schema key (of JSON Schema) for words beside file names, such as the built-in illuminants.
pub const EXAMPLE_WORDS: &str = "examples";

/// Schema key of all options: description of the input.
pub const INPUT: &str = "x-input";

/// Schema key of all options: example command lines, and the files that the operation writes.
pub const EXAMPLES: &str = "x-examples";

/// An option.
#[derive(Clone, Debug, PartialEq)]
pub struct Field {
    /// Keys that lead to it; more than one within nested structures.
    pub path: Vec<String>,
    /// Its schema without references, and without `null` as a type.
    pub schema: Map<String, Value>,
    /// Whether it must be given.
    pub required: bool,
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
            collect(&root, schema, &[], &mut list);
        }
        Self { root, list }
    }

    /// The whole schema, with its definitions.
    pub fn schema(&self) -> &Value {
        &self.root
    }

    /// A text of the whole, such as [`EXAMPLES`]; empty where there is none.
    pub fn text(&self, key: &str) -> &str {
        self.root[key].as_str().unwrap_or_default()
    }
}

/// Options of a structure; those of structures in it that are no file follow in its place.
fn collect(root: &Value, structure: &Map<String, Value>, path: &[String], list: &mut Vec<Field>) {
    let required = structure.get("required").and_then(Value::as_array);
    for (key, property) in structure.get("properties").and_then(Value::as_object).into_iter().flatten() {
        let path: Vec<String> = path.iter().chain([key]).cloned().collect();
        let schema = resolved(root, property);
        if schema.contains_key("properties") && !is_file(&schema) {
            let first = list.len();
            collect(root, &schema, &path, list);
            if let Some(advanced) = schema.get(ADVANCED) {
                list[first..].iter_mut().for_each(|f| drop(f.schema.insert(ADVANCED.into(), advanced.clone())));
            }
            continue;
        }
        let needed = required.is_some_and(|all| all.iter().any(|name| name == key)) && path.len() == 1;
        list.push(Field { path, schema, required: needed });
    }
}

fn is_file(schema: &Map<String, Value>) -> bool {
    schema.get(FILE) == Some(&Value::Bool(true))
}

/// A schema with its references replaced, and without `null`. What stands beside a reference wins.
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
    /// A text of its schema.
    pub fn text(&self, key: &str) -> Option<&str> {
        self.schema.get(key).and_then(Value::as_str)
    }

    /// Whether it names a file.
    pub fn is_file(&self) -> bool {
        is_file(&self.schema)
    }

    /// Name with dashes, as a command line and a form call it: `light-scale` for `scale` in `light`, and `light` for `path` in it.
    pub fn name(&self) -> String {
        let last = self.path.len() - 1;
        let keys = self.path.iter().enumerate().filter(|(k, key)| *k == 0 || *k < last || *key != "path");
        keys.map(|(_, key)| key.replace('_', "-")).collect::<Vec<_>>().join("-")
    }

    /// Other names of it.
    pub fn aliases(&self) -> Vec<String> {
        let all = self.schema.get(ALIASES).and_then(Value::as_array);
        all.into_iter().flatten().filter_map(|name| name.as_str().map(str::to_owned)).collect()
    }

    /// Its default; none where that is left to the program.
    pub fn default(&self) -> Option<&Value> {
        self.schema.get("default").filter(|value| !value.is_null())
    }

    /// Whether few need it.
    pub fn is_advanced(&self) -> bool {
        self.schema.get(ADVANCED) == Some(&Value::Bool(true))
    }

    /// Whether it is yes or no.
    pub fn is_flag(&self) -> bool {
        self.text("type") == Some("boolean")
    }

    /// Whether its value is a structure.
    pub fn is_structure(&self) -> bool {
        let structure = |schema: &Map<String, Value>| schema.contains_key("properties");
        let alternatives = self.schema.get("anyOf").and_then(Value::as_array);
        structure(&self.schema)
            || alternatives.is_some_and(|all| all.iter().filter_map(Value::as_object).all(structure))
    }

    /// Words that it may be, if it can be nothing else.
    pub fn words(&self) -> Option<Vec<String>> {
        words(&self.schema)
    }

    /// Placeholder of its value: the stated one, its words, or the unit that its name ends in.
    pub fn placeholder(&self) -> String {
        if let Some(stated) = self.text(PLACEHOLDER) {
            return stated.into();
        }
        if let Some(words) = self.words() {
            return words.join("|");
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

    /// The kind of text that its value is read from, for messages.
    pub fn expected(&self) -> String {
        let placeholder = self.placeholder();
        match (self.text("type"), self.schema.get("minItems").and_then(Value::as_u64)) {
            (Some("array"), Some(2)) => format!("two numbers: {placeholder}"),
            (Some("array"), Some(count)) => format!("{count} numbers or lists of numbers: {placeholder}"),
            _ => placeholder,
        }
    }

    /// Value that a text means.
    ///
    /// # Errors
    /// The values that are possible.
    pub fn value(&self, text: &str) -> Result<Value, String> {
        if self.text(UNSET) == Some(text) {
            return Ok(Value::Null);
        }
        read(&self.schema, text).ok_or_else(|| format!("{text:?} is no {}", self.placeholder()))
    }

    /// Puts a value where it belongs among the options.
    pub fn put(&self, options: &mut Value, value: Value) {
        let place = self.path.iter().fold(options, |at, key| {
            if !at.is_object() {
                *at = Value::Object(Map::new());
            }
            &mut at[key.as_str()]
        });
        *place = value;
    }

    /// The name of a file among options: its value, or that of a variant that names a file.
    pub fn file<'a>(&self, options: &'a mut Value) -> Option<&'a mut Value> {
        let variants = self.schema.get("oneOf").and_then(Value::as_array);
        let variants = variants.into_iter().flatten().filter_map(Value::as_object).filter(|one| is_file(one));
        let keys: Vec<&String> = variants.filter_map(|one| one.get("properties")?.as_object()?.keys().next()).collect();
        let value = self.path.iter().try_fold(options, |at, key| at.get_mut(key))?;
        if self.is_file() {
            return Some(value);
        }
        let given = value.as_object_mut()?;
        given.iter_mut().find(|(key, _)| keys.contains(key)).map(|(_, name)| name)
    }

    /// Whether a word is one of the built-in values beside file names.
    pub fn is_built_in(&self, word: &str) -> bool {
        let words = self.schema.get(EXAMPLE_WORDS).and_then(Value::as_array);
        words.into_iter().flatten().any(|known| known == word)
    }

    /// Its value among options, if it is given.
    pub fn get<'a>(&self, options: &'a Value) -> Option<&'a Value> {
        self.path.iter().try_fold(options, |at, key| at.get(key))
    }
}

/// Words of a schema of nothing but words.
fn words(schema: &Map<String, Value>) -> Option<Vec<String>> {
    if let Some(word) = schema.get("const") {
        return Some(vec![word.as_str()?.to_owned()]);
    }
    if let Some(Value::Array(all)) = schema.get("enum") {
        return all.iter().map(|word| word.as_str().map(str::to_owned)).collect();
    }
    let Some(Value::Array(all)) = schema.get("oneOf") else { return None };
    let each = all.iter().map(|one| words(one.as_object()?));
    Some(each.collect::<Option<Vec<_>>>()?.concat())
}

/// Value of a schema that a text means.
fn read(schema: &Map<String, Value>, text: &str) -> Option<Value> {
    if let Some(words) = words(schema) {
        let same = |word: &&String| word.replace('_', "-") == text.replace('_', "-");
        return words.iter().find(same).map(|word| Value::from(word.as_str()));
    }
    for key in ["oneOf", "anyOf"] {
        if let Some(Value::Array(all)) = schema.get(key) {
            return all.iter().filter_map(Value::as_object).find_map(|one| read(one, text));
        }
    }
    match schema.get("type").and_then(Value::as_str)? {
        "string" => Some(text.into()),
        "boolean" => text.parse::<bool>().ok().map(Value::from),
        "integer" => text.parse::<i64>().ok().map(Value::from),
        "number" => text.parse::<f64>().ok().filter(|v| v.is_finite()).map(Value::from),
        "array" => {
            let parts: Vec<&str> = text.split([',', ':', ';', 'x', '×']).map(str::trim).collect();
            let mut parts = parts.into_iter();
            let list = filled(schema, &mut parts)?;
            parts.next().is_none().then_some(list)
        }
        "object" => named(schema, text),
        _ => None,
    }
}

/// A list, and lists in it, from the next parts.
fn filled<'a>(schema: &Map<String, Value>, parts: &mut impl Iterator<Item = &'a str>) -> Option<Value> {
    if schema.get("type").and_then(Value::as_str) != Some("array") {
        return read(schema, parts.next()?);
    }
    let count = |key: &str| schema.get(key).and_then(Value::as_u64);
    let count = count("minItems").filter(|n| count("maxItems") == Some(*n))?;
    let each = schema.get("items")?.as_object()?;
    (0..count).map(|_| filled(each, parts)).collect::<Option<Vec<_>>>().map(Value::from)
}

/// A variant with a value: `name=value`, or its name for the usual value.
fn named(schema: &Map<String, Value>, text: &str) -> Option<Value> {
    let (key, inner) = schema.get("properties")?.as_object()?.iter().next()?;
    let (name, value) = text.split_once('=').map_or((text, None), |(name, value)| (name, Some(value)));
    if name.replace('-', "_") != key.replace('-', "_") {
        return None;
    }
    let value = match value {
        Some(value) => read(inner.as_object()?, value)?,
        None => schema.get(BARE)?.clone(),
    };
    Some(Value::Object(Map::from_iter([(key.clone(), value)])))
}

#[cfg(test)]
mod tests {
    use super::*;
    use schemars::JsonSchema;
    use serde_json::json;

    /// Ways of adding up.
    #[derive(JsonSchema)]
    #[schemars(rename_all = "snake_case")]
    #[allow(dead_code)]
    enum Way {
        Auto,
        #[schemars(extend("x-bare" = 0.5))]
        Single(f64),
    }

    #[derive(JsonSchema)]
    #[schemars(rename_all = "snake_case")]
    #[allow(dead_code)]
    enum Word {
        One,
        TwoWords,
    }

    #[derive(JsonSchema)]
    #[allow(dead_code)]
    struct Light {
        #[schemars(extend("x-file" = true))]
        path: String,
        scale: Option<f64>,
    }

    /// Options of a test.
    #[derive(JsonSchema)]
    #[schemars(extend("x-examples" = "nacre test"))]
    #[allow(dead_code)]
    struct Options {
        /// Wavelength.
        #[schemars(extend("x-aliases" = ["wavelength"]))]
        wavelength_nm: Option<f64>,
        #[schemars(extend("x-unset" = "auto"))]
        center: Option<[f64; 2]>,
        corners: [[f64; 2]; 4],
        way: Way,
        word: Word,
        deep: bool,
        light: Option<Light>,
    }

    fn fields() -> Fields {
        Fields::of(schemars::schema_for!(Options).to_value())
    }

    fn value(name: &str, text: &str) -> Result<Value, String> {
        fields().list.iter().find(|f| f.name() == name).unwrap().value(text)
    }

    #[test]
    fn names_follow_from_keys() {
        let names: Vec<String> = fields().list.iter().map(Field::name).collect();
        assert_eq!(names, ["wavelength-nm", "center", "corners", "way", "word", "deep", "light", "light-scale"]);
        assert_eq!(fields().text(EXAMPLES), "nacre test");
        let all = fields();
        let nm = all.list.iter().find(|f| f.name() == "wavelength-nm").unwrap();
        assert_eq!((nm.placeholder().as_str(), nm.aliases()), ("NM", vec!["wavelength".to_owned()]));
    }

    #[test]
    fn texts_become_values_of_the_schema() {
        assert_eq!(value("wavelength-nm", "680").unwrap(), json!(680.0));
        assert_eq!(value("center", "auto").unwrap(), Value::Null);
        assert_eq!(value("center", "1.5,2").unwrap(), json!([1.5, 2.0]));
        assert_eq!(value("center", "3x4").unwrap(), json!([3.0, 4.0]));
        assert_eq!(value("corners", "0,0,1,0,1,1,0,1").unwrap()[2], json!([1.0, 1.0]));
        assert_eq!(value("way", "auto").unwrap(), json!("auto"));
        assert_eq!(value("way", "single").unwrap(), json!({ "single": 0.5 }));
        assert_eq!(value("way", "single=0.25").unwrap(), json!({ "single": 0.25 }));
        assert_eq!(value("word", "two-words").unwrap(), json!("two_words"));
        for (name, text) in
            [("center", "1"), ("center", "1,2,3"), ("wavelength-nm", "NaN"), ("way", "triple=1"), ("word", "three")]
        {
            assert!(value(name, text).is_err(), "{name} {text}");
        }
        assert!(value("word", "three").unwrap_err().contains("one|two_words"));
    }

    #[test]
    fn values_are_put_where_they_belong() {
        let mut options = json!({});
        for field in fields().list.iter().filter(|f| f.path[0] == "light") {
            field.put(&mut options, json!(field.name()));
            assert_eq!(field.get(&options).unwrap(), &json!(field.name()));
        }
        assert_eq!(options, json!({ "light": { "path": "light", "scale": "light-scale" } }));
    }
}

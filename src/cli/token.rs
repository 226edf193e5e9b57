//! `rotorwatch token`: makes, lists and revokes the access tokens of a daemon, in the file that it reads.
//!
//! The file holds digests. A secret is printed once, when it is made, and nowhere else.

use super::alarms::seconds;
use super::output::OutputError;
use super::output::Spared;
use crate::access::ListError;
use crate::access::Role;
use crate::access::Secret;
use crate::access::Token;
use crate::access::TokenError;
use crate::access::Tokens;
use crate::app;
use crate::config;
use crate::config::ConfigErrors;
use crate::signal::Timestamp;
use clap::Args;
use clap::Subcommand;
use clap::ValueEnum;
use rand::TryRng;
use rand::rngs::SysRng;
use serde_json::json;
use std::fs;
use std::fs::File;
use std::io;
use std::io::Write;
use std::os::unix::fs::MetadataExt;
use std::os::unix::fs::OpenOptionsExt;
use std::os::unix::fs::PermissionsExt;
use std::os::unix::fs::chown;
use std::path::Path;
use std::path::PathBuf;
use std::process::ExitCode;
use tempfile::NamedTempFile;

/// Shown below `--help`.
pub const EXAMPLES: &str = "\
Examples:
  rotorwatch token create --label 'M. Ito' --role operator --config rotorwatch.toml
  rotorwatch token create --label 'line 3 gateway' --role ingest --machine rig-1 --config rotorwatch.toml --out gateway.token
  rotorwatch token create --label grafana --role viewer --expires 365d --file tokens.toml
  rotorwatch token list --config rotorwatch.toml
  rotorwatch token revoke 'M. Ito' --config rotorwatch.toml

The daemon reads the file server.token_file of its configuration again within a second of a change. Only digests stand in it: who loses
a secret gets another token. Roles: viewer sees; operator acts on alarms, too; admin decides what is normal, too; ingest sends samples.

Exit codes: 0 success, 2 an error.";

/// Arguments of `token`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
}

/// What to do with tokens.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Make a token and print its secret, once
    Create(CreateArguments),
    /// List the tokens, without their secrets
    List(ListArguments),
    /// Revoke a token: who has it is out within a second
    Revoke(RevokeArguments),
}

/// Where the tokens are.
#[derive(Debug, Args)]
#[group(required = true, multiple = false)]
pub struct Place {
    /// Configuration of the daemon, which names the file in server.token_file.
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// The file of tokens itself.
    #[arg(long, value_name = "FILE")]
    pub file: Option<PathBuf>,
}

/// What a token may do.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum RoleArgument {
    /// Sees everything but who did what.
    Viewer,
    /// Acts on alarms, silences, captures, too.
    Operator,
    /// Decides what is normal, too.
    Admin,
    /// Sends samples, and nothing else.
    Ingest,
}

impl From<RoleArgument> for Role {
    fn from(role: RoleArgument) -> Self {
        match role {
            RoleArgument::Viewer => Self::Viewer,
            RoleArgument::Operator => Self::Operator,
            RoleArgument::Admin => Self::Admin,
            RoleArgument::Ingest => Self::Ingest,
        }
    }
}

/// A new token.
#[derive(Debug, Args)]
pub struct CreateArguments {
    /// Whose it is: the author of what is done with it.
    #[arg(long, value_name = "NAME")]
    pub label: String,
    /// What it may do.
    #[arg(long, value_enum, value_name = "ROLE")]
    pub role: RoleArgument,
    /// Of this machine only; may be repeated. Others are not there for it.
    #[arg(long, value_name = "ID")]
    pub machine: Vec<String>,
    /// Time until it ends: a number with s, min, h or d, such as 365d. Without it: when it is revoked.
    #[arg(long, value_name = "TIME", value_parser = seconds)]
    pub expires: Option<f64>,
    /// Write the secret into this new file, which nobody else can read, instead of printing it.
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
    /// Where the tokens are.
    #[command(flatten)]
    pub place: Place,
}

/// Which list.
#[derive(Debug, Args)]
pub struct ListArguments {
    /// How it is written.
    #[arg(long, value_enum, default_value = "text", value_name = "FORMAT")]
    pub format: super::alarms::Format,
    /// Where the tokens are.
    #[command(flatten)]
    pub place: Place,
}

/// Which token.
#[derive(Debug, Args)]
pub struct RevokeArguments {
    /// Its label.
    #[arg(value_name = "LABEL")]
    pub label: String,
    /// Where the tokens are.
    #[command(flatten)]
    pub place: Place,
}

/// Why it was not done.
#[derive(Debug, thiserror::Error)]
enum Failure {
    #[error("the configuration is refused")]
    Configuration(#[from] ConfigErrors),
    #[error("{}: server.token_file names no file of tokens; name one there, or here with --file", config.display())]
    NoFile { config: PathBuf },
    #[error("{}: the tokens cannot be read", file.display())]
    Read { file: PathBuf, source: io::Error },
    #[error("{}: {source}", file.display())]
    List { file: PathBuf, source: ListError },
    #[error("{}: cannot be written", file.display())]
    Write { file: PathBuf, source: io::Error },
    #[error(transparent)]
    Output(#[from] OutputError),
    #[error(transparent)]
    Token(#[from] TokenError),
    #[error("the system gives no random numbers")]
    Random(#[source] rand::rngs::SysError),
    #[error("no token has the label {label:?}; there are: {known}")]
    Unknown { label: String, known: String },
}

/// Runs the command.
#[must_use]
pub fn run(arguments: &Arguments) -> ExitCode {
    let done = match &arguments.command {
        Command::Create(create) => self::create(create),
        Command::List(list) => self::list(list),
        Command::Revoke(revoke) => self::revoke(revoke),
    };
    match done {
        Ok(text) => super::print(text.as_bytes()),
        Err(failure) => super::fail(&failure),
    }
}

fn create(arguments: &CreateArguments) -> Result<String, Failure> {
    let mut random = [0; 32];
    SysRng.try_fill_bytes(&mut random).map_err(Failure::Random)?;
    let secret = Secret::of(&random);
    let now = app::wall_clock();
    let times = (Some(now), arguments.expires.map(|after_s| now.plus_seconds(after_s)));
    let who = (&*arguments.label, arguments.role.into());
    let token = Token::new(&secret, who, &arguments.machine, times)?;
    let file = file_of(&arguments.place)?;
    if let Some(out) = &arguments.out {
        spared(&arguments.place, &file).refuse(out)?;
    }
    let locked = Locked::open(&file)?;
    let mut tokens = locked.read()?;
    tokens.add(token).map_err(|source| Failure::List { file: file.clone(), source })?;
    // First the secret, then the token: one that nobody has is of no use.
    let told = match &arguments.out {
        Some(out) => {
            write_secret(out, &secret)
                .map_err(|source| Failure::Write { file: out.clone(), source })?;
            format!("the secret is in {}\n", out.display())
        }
        None => format!("{}\n", secret.reveal()),
    };
    locked.write(&tokens)?;
    let note =
        format!("{}: token {:?} made; its secret is not stored\n", file.display(), arguments.label);
    // Beside the secret, so that that can go into a file alone.
    let _no_stderr = io::stderr().write_all(note.as_bytes());
    Ok(told)
}

/// What a secret is not written into; of a configuration with mistakes no more than is known.
fn spared(place: &Place, tokens: &Path) -> Spared {
    let config =
        place.config.as_deref().map(|file| config::load_as(file, config::Exposure::Insecure));
    let of_config = config.and_then(Result::ok).as_ref().map(Spared::of);
    of_config.unwrap_or_default().and(&place.config).and([tokens])
}

/// Writes a new file that nobody else can read.
fn write_secret(out: &Path, secret: &Secret) -> io::Result<()> {
    let mut file = File::options().write(true).create_new(true).mode(0o600).open(out)?;
    writeln!(file, "{}", secret.reveal())?;
    file.sync_all()
}

fn list(arguments: &ListArguments) -> Result<String, Failure> {
    let file = file_of(&arguments.place)?;
    let tokens = Locked::open(&file)?.read()?;
    let now = app::wall_clock();
    let time = |at: Option<Timestamp>| {
        at.and_then(|at| jiff::Timestamp::from_nanosecond(at.0.into()).ok())
            .map(|at| format!("{at:.0}"))
    };
    if arguments.format == super::alarms::Format::Json {
        let item = |token: &std::sync::Arc<Token>| {
            json!({
                "label": token.label(), "role": token.role().name(), "machines": token.machines(),
                "created": time(token.created()), "expires": time(token.expires()),
                "expired": token.is_expired(now),
            })
        };
        let items: Vec<_> = tokens.iter().map(item).collect();
        return Ok(format!("{:#}\n", json!({ "items": items })));
    }
    let line = |token: &std::sync::Arc<Token>| {
        let machines = if token.is_restricted() {
            token.machines().join(", ")
        } else {
            "all machines".to_owned()
        };
        let ends = match (time(token.expires()), token.is_expired(now)) {
            (None, _) => "no end".to_owned(),
            (Some(at), true) => format!("EXPIRED {at}"),
            (Some(at), false) => format!("until {at}"),
        };
        let made = time(token.created()).unwrap_or_default();
        format!(
            "{:<24} {:<8} {machines}, made {made}, {ends}\n",
            token.label(),
            token.role().name()
        )
    };
    let text: String = tokens.iter().map(line).collect();
    Ok(if text.is_empty() { "none\n".to_owned() } else { text })
}

fn revoke(arguments: &RevokeArguments) -> Result<String, Failure> {
    let file = file_of(&arguments.place)?;
    let locked = Locked::open(&file)?;
    let mut tokens = locked.read()?;
    if !tokens.revoke(&arguments.label) {
        let known = tokens.labels().into_iter().collect::<Vec<_>>().join(", ");
        return Err(Failure::Unknown { label: arguments.label.clone(), known });
    }
    locked.write(&tokens)?;
    Ok(format!("{}: token {:?} revoked\n", file.display(), arguments.label))
}

fn file_of(place: &Place) -> Result<PathBuf, Failure> {
    match (&place.file, &place.config) {
        (Some(file), _) => Ok(file.clone()),
        (None, Some(config)) => {
            config::token_file(config)?.ok_or_else(|| Failure::NoFile { config: config.clone() })
        }
        (None, None) => Err(Failure::NoFile { config: PathBuf::new() }),
    }
}

/// A file of tokens that no other command changes meanwhile.
struct Locked {
    file: PathBuf,
    folder: PathBuf,
    /// The lock is that of the folder: the file itself is exchanged as a whole.
    _lock: File,
}

impl Locked {
    fn open(file: &Path) -> Result<Self, Failure> {
        let folder = match file.parent() {
            Some(parent) if !parent.as_os_str().is_empty() => parent.to_owned(),
            _ => PathBuf::from("."),
        };
        let locked = File::open(&folder).and_then(|lock| lock.lock().map(|()| lock));
        let lock = locked.map_err(|source| Failure::Read { file: folder.clone(), source })?;
        Ok(Self { file: file.to_owned(), folder, _lock: lock })
    }

    /// The tokens; none where there is no file yet.
    fn read(&self) -> Result<Tokens, Failure> {
        let file = self.file.clone();
        match fs::read_to_string(&self.file) {
            Ok(text) => Tokens::parse(&text).map_err(|source| Failure::List { file, source }),
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(Tokens::default()),
            Err(source) => Err(Failure::Read { file, source }),
        }
    }

    /// Exchanges the file: whoever reads it sees what was, or what is. Owner, group and mode stay; a new one is its owner's
    /// alone.
    fn write(&self, tokens: &Tokens) -> Result<(), Failure> {
        let written = || {
            let mut new = NamedTempFile::new_in(&self.folder)?;
            new.write_all(tokens.text().as_bytes())?;
            if let Ok(before) = fs::metadata(&self.file) {
                let own = new.as_file().metadata()?;
                if (own.uid(), own.gid()) != (before.uid(), before.gid()) {
                    chown(new.path(), Some(before.uid()), Some(before.gid()))?;
                }
                let mode = before.permissions().mode() & 0o640;
                new.as_file().set_permissions(fs::Permissions::from_mode(mode))?;
            }
            new.as_file().sync_all()?;
            new.persist(&self.file).map_err(|error| error.error)?;
            File::open(&self.folder)?.sync_all()
        };
        written().map_err(|source| Failure::Write { file: self.file.clone(), source })
    }
}

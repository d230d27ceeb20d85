// Starts `pomona lsp` for YAML files; the server looks only at those that are trees.
const { commands, window, workspace } = require("vscode");
const { LanguageClient } = require("vscode-languageclient/node");

let client;

function options() {
  const settings = workspace.getConfiguration("pomona");
  const folder = workspace.workspaceFolders?.[0]?.uri.fsPath ?? "";
  const command = settings.get("command", "pomona").replace("${workspaceFolder}", folder);
  return { command, cell: settings.get("cell", "") };
}

async function start() {
  const { command, cell } = options();
  client = new LanguageClient(
    "pomona",
    "Pomona",
    { command, args: ["lsp"], options: { cwd: workspace.workspaceFolders?.[0]?.uri.fsPath } },
    { documentSelector: [{ scheme: "file", language: "yaml" }], initializationOptions: { cell } },
  );
  try {
    await client.start();
  } catch (error) {
    window.showWarningMessage(`Pomona's language server did not start (${command} lsp): ${error.message}`);
  }
}

async function restart() {
  await client?.stop().catch(() => {});
  await start();
}

async function activate(context) {
  context.subscriptions.push(commands.registerCommand("pomona.restart", restart));
  context.subscriptions.push(workspace.onDidChangeConfiguration((event) => event.affectsConfiguration("pomona") && restart()));
  await start();
}

async function deactivate() {
  await client?.stop();
}

module.exports = { activate, deactivate };

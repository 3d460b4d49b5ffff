// SPDX-License-Identifier: GPL-3.0-or-later

// What Flamenco makes of a job type: node flamenco_job.js SCRIPT SETTINGS prints its settings and the tasks of a job.
// Stands in for the globals that Flamenco Manager gives to a job type, for ranges like 1-1000.

const fs = require("fs");
const vm = require("vm");

const [script, given] = process.argv.slice(2);
const tasks = [];

class Task {
    constructor(name, type) { Object.assign(this, { name, type, commands: [], dependencies: [] }); }
    addCommand(command) { this.commands.push(command); }
    addDependency(task) { this.dependencies.push(task.name); }
}

const globals = {
    author: {
        Task: (name, type) => new Task(name, type),
        Command: (name, parameters) => ({ name, parameters }),
    },
    path: { join: (...parts) => parts.join("/") },
    frameChunker: (range, size) => {
        const [first, last] = range.split("-").map(Number);
        const chunks = [];
        for (let start = first; start <= (last || first); start += size) {
            const end = Math.min(start + size - 1, last || first);
            chunks.push(start === end ? `${start}` : `${start}-${end}`);
        }
        return chunks;
    },
    print: () => {},
};

const context = vm.createContext(globals);
vm.runInContext(fs.readFileSync(script, "utf-8"), context, { filename: script });
const jobType = vm.runInContext("JOB_TYPE", context);
const settings = {};
for (const setting of jobType.settings) {
    if ("default" in setting) settings[setting.key] = setting.default;
}
Object.assign(settings, JSON.parse(given));
context.job = { name: "job", settings, addTask: (task) => tasks.push(task) };
vm.runInContext("compileJob(job)", context);
console.log(JSON.stringify({ jobType, tasks }));

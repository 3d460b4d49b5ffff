// SPDX-License-Identifier: GPL-3.0-or-later

// CC Depth over many files, several of them to a task: a job type for Flamenco 3. docs/farm.md says how to use it.

const JOB_TYPE = {
    label: "CC Depth",
    description: "Do the files of a list with CC Depth, and gather the reports into one",
    settings: [
        { key: "file_list", type: "string", subtype: "file_path", required: true,
          description: "A text file with the path of a file in each line, absolute or relative to its folder" },
        { key: "files", type: "string", required: true,
          description: "The lines of the list to do, like 1-1000" },
        { key: "chunk_size", type: "int32", default: 25,
          description: "The number of files of a task" },
        { key: "options", type: "string", default: "",
          description: "Options of CC Depth's command line but for files and reports, like " +
            "--subdivide --tolerance 0.1mm. Relative paths begin at the folder of the list" },
        { key: "report_folder", type: "string", subtype: "dir_path", required: true,
          description: "The folder of the reports. report.json, .csv and .html there are about all files" },
        { key: "script", type: "string", subtype: "file_path", required: true,
          description: "The place of CC Depth's run_files.py on the workers" },
        { key: "python", type: "string", default: "python3",
          description: "A Python of version 3.9 or later" },
    ],
};

function compileJob(job) {
    const settings = job.settings;
    const taskReports = path.join(settings.report_folder, "tasks");
    const reportTask = author.Task("report", "blender");
    const reportArgs = ["-b", "--command", "ccdepth", "--gather=" + taskReports, "--overwrite"];
    for (const kind of ["json", "csv", "html"]) {
        reportArgs.push("--" + kind + "=" + path.join(settings.report_folder, "report." + kind));
    }
    reportTask.addCommand(author.Command("exec", { exe: "{blender}", args: reportArgs }));
    for (const lines of frameChunker(settings.files, settings.chunk_size)) {
        const task = author.Task("files-" + lines, "blender");
        task.addCommand(author.Command("exec", {
            exe: settings.python,
            args: [
                settings.script, settings.file_list, lines, taskReports,
                "--blender={blender}", "--options=" + settings.options,
            ],
        }));
        reportTask.addDependency(task);
        job.addTask(task);
    }
    job.addTask(reportTask);
}

#!/bin/sh
# Everything that results/gpu wants to know of a machine with an NVIDIA GPU, in one call of under nine minutes:
#
#     PYTHON=.venv/bin/python sh tools/gpu_report.sh [FOLDER]
#
# It needs the extra `gpu` and a CUDA build of torch. Into FOLDER (results/gpu/report) go
#   machine.txt        the card, and the versions
#   throughput.jsonl   control steps a second by number of robots: bare MuJoCo Warp, its arrays on the host, the task on
#                      the host, the task on the device
#   agreement.json     whether the two tasks are one: means over robots, by their standard errors
#   run/               a training with --device cuda (DEVICE), by default 4096 robots, 200 iterations (ROBOTS, ITERATIONS)
#   training.json      its seconds, and after how many the robots follow within 0.85 to 1.15 in both directions
#   evaluation/        the policy without exploration noise, on the processor
# Each part has a time limit of its own; what one did not come to is said, and the others go on. Failed parts: status 1.
set -u
folder=${1:-results/gpu/report}
python=${PYTHON:-python}
device=${DEVICE:-cuda}
failed=0
mkdir -p "$folder"

part() { # NAME SECONDS COMMAND...: run a part within its time; say how it ended
    name=$1 limit=$2
    shift 2
    begin=$(date +%s)
    timeout -s INT -k 10 "$limit" "$@"
    status=$?
    echo "gpu_report: $name: status $status after $(($(date +%s) - begin)) s" >&2
    [ $status -eq 0 ] || failed=1
    return $status
}

{
    nvidia-smi --query-gpu=name,memory.total,driver_version --format=csv
    "$python" -c "import os, torch, warp; print(os.cpu_count(), 'cores, torch', torch.__version__, 'warp', warp.__version__)"
} > "$folder/machine.txt" 2>&1
cat "$folder/machine.txt" >&2

part throughput 190 "$python" tools/gpu_throughput.py "$device" "${COUNTS:-512,2048,4096,8192,16384}" \
    > "$folder/throughput.jsonl"
part agreement 60 "$python" tools/gpu_agreement.py "$device" "${COMPARED:-2048}" > "$folder/agreement.json"

rm -rf "$folder/run"
if part training 240 "$python" -m stiction train --preset quick --method deception --friction-level 0.2 --device "$device" \
    --num-envs "${ROBOTS:-4096}" --teacher.iterations "${ITERATIONS:-200}" --video-every 0 --out "$folder/run" \
    --json > "$folder/summary.json"
then
    part export 30 "$python" -m stiction export "$folder/run" --json > "$folder/export.json" &&
        part evaluation 60 "$python" -m stiction evaluate "$folder/run/bundle" --friction-levels 0 0.1 0.2 \
            --episodes 6 --seconds 10 --out "$folder/evaluation" --json > "$folder/evaluation.json"
fi
part figures 10 "$python" tools/gpu_training.py "$folder/run" > "$folder/training.json"
cat "$folder/throughput.jsonl" "$folder/training.json"
exit $failed

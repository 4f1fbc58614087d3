defmodule BB.Sensor.SystemConformanceTest do
  # The kernel's files, in a folder of their own.
  defmodule Files do
    use GenServer

    import BB.Test.KernelFiles

    @behaviour BB.Sensor.Conformance.Wires

    @memory "proc/meminfo"

    @impl true
    def faults, do: [:unreadable, :nonsense]

    @impl true
    def absence, do: :unreadable

    @impl true
    def stuck, do: :unreadable

    @impl true
    def deceptive, do: []

    @impl true
    def start(setting, name, _clock) do
      root = Path.join(System.tmp_dir!(), BB.Test.Run.unique(name))
      for {file, text} <- setting.device, do: put(root, file, text)
      {:ok, owner} = GenServer.start_link(__MODULE__, root)
      {owner, %{root: root, files: setting.device}}
    end

    @impl true
    def init(root), do: {:ok, root}

    @impl true
    def terminate(_reason, root), do: File.rm_rf!(root)

    @impl true
    def options(place), do: [root: place.root]

    @impl true
    def exchange(_place, _device), do: :ok

    @impl true
    def break(place, :unreadable), do: File.rm!(Path.join(place.root, @memory))
    def break(place, :nonsense), do: put(place.root, @memory, "nothing that the kernel would say")

    @impl true
    def mend(place, _fault), do: put(place.root, @memory, place.files[@memory])

    @impl true
    def free?(_place), do: true
  end

  use BB.Sensor.Conformance,
    driver: {BB.Sensor.System, rate: 10},
    wires: Files,
    device: %{
      "proc/meminfo" => "MemTotal: 1000000 kB\nMemFree: 100000 kB\nMemAvailable: 400000 kB\n",
      "proc/loadavg" => "0.25 1.50 2.00 3/120 4711\n",
      "sys/devices/system/cpu/online" => "0-3\n"
    },
    new_options: [rate: 5]
end

defmodule BB.Sensor.Conformance.Setting do
  @moduledoc """
  The checked options of `use BB.Sensor.Conformance`: a driver, its device and the faults.

  `BB.Sensor.Conformance` makes one for each test.
  """
  @moduledoc no_example: "internal: BB.Sensor.Conformance documents the options"

  alias BB.Sensor.Conformance.{GPIO, I2C}

  @enforce_keys [:driver, :options, :wires, :device, :faults]
  defstruct [
    :driver,
    :options,
    :wires,
    :device,
    :address,
    :other_device,
    :event,
    :faults,
    :new_options,
    :unseen,
    :patience_ms
  ]

  @type device :: {module(), keyword()}

  @type t :: %__MODULE__{
          driver: module(),
          options: keyword() | (map() -> keyword()),
          wires: module(),
          device: device() | term(),
          address: byte() | nil,
          other_device: device() | nil,
          event: (map(), pos_integer() -> term()) | nil,
          faults: [atom()],
          new_options: keyword(),
          unseen: [atom()],
          patience_ms: pos_integer()
        }

  @accepted [
    :driver,
    :wires,
    :device,
    :address,
    :other_device,
    :event,
    :faults,
    new_options: [],
    unseen: [],
    patience_ms: 30_000
  ]

  @doc "Returns the setting of the given options. Wrong options raise `ArgumentError`."
  @spec new!(keyword()) :: t()
  def new!(opts) do
    opts = Keyword.validate!(opts, @accepted)
    {driver, options} = fetch_pair!(opts, :driver)
    device = if opts[:wires], do: opts[:device], else: fetch_pair!(opts, :device)
    wires = opts[:wires] || default_wires(device)
    faults = opts[:faults] || wires.faults()
    check_faults!(Enum.uniq(faults ++ opts[:unseen]), wires.faults())

    %__MODULE__{
      driver: driver,
      options: options,
      wires: wires,
      device: device,
      address: opts[:address] || option(driver, options, :address),
      other_device: opts[:other_device],
      event: opts[:event],
      faults: faults,
      new_options: opts[:new_options],
      unseen: opts[:unseen],
      patience_ms: opts[:patience_ms]
    }
  end

  @doc "Returns the value of a driver's option: the given one, or the default of its schema."
  @spec option(module(), keyword() | function(), atom()) :: term()
  def option(driver, options, key) do
    given = if is_list(options), do: options, else: []
    Keyword.get_lazy(given, key, fn -> default(driver, key) end)
  end

  # A model of a device on GPIO lines defines pins/0.
  defp default_wires({model, _options}),
    do: if(function_exported?(model, :pins, 0), do: GPIO, else: I2C)

  defp default(driver, key) do
    schema = BB.Options.new!(driver.options_schema()).schema
    get_in(schema, [key, :default])
  end

  defp fetch_pair!(opts, key) do
    case opts[key] do
      {module, options} when is_atom(module) and (is_list(options) or is_function(options, 1)) ->
        Code.ensure_loaded!(module)
        {module, options}

      other ->
        raise ArgumentError, "expected #{key}: {module, options}, got: #{inspect(other)}"
    end
  end

  defp check_faults!(faults, known) do
    case faults -- known do
      [] ->
        :ok

      [other | _] ->
        raise ArgumentError, "expected faults out of #{inspect(known)}, got: #{inspect(other)}"
    end
  end
end
